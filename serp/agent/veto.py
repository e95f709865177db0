"""Veto policies: which actions are refused, and why."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from serp._util.saved_state import Declared, Reader, count, part, probability, within
from serp._util.text import percent, plural
from serp.agent.decision import Reason
from serp.agent.protocols import Mask
from serp.agent.step_record import StepRecord
from serp.model.flags import APPLICABLE, RISKY, UNDEFINED, UNSAFE
from serp.planning.forecast import SAFE, held_back
from serp.settings import ArbiterSettings
from serp.tasks.action_map import ActionForecast, ActionMap


class LookaheadReliability(Declared):
    """Counts the failures of the lookahead.

    The lookahead predicts an executed action to be safe if a plan exists that avoids everything
    unsafe within the horizon, in control periods. It has failed if something unsafe is observed
    within the horizon nevertheless. A lookahead that fails more than three times (plus once per
    1,000 env steps) does not model what endangers the robot, so its vetoes beyond the next step are
    not justified.
    """

    STATE: ClassVar[Mapping[str, Reader]] = {"failures": count, "steps": count}

    def __init__(self, horizon: int) -> None:
        self._horizon = horizon
        self.failures = 0
        self.steps = 0
        self._since: dict[int, int] = {}
        """Environment → env steps since the newest prediction of safety in its episode."""

    @property
    def reliable(self) -> bool:
        """Whether vetoes use the lookahead beyond the next step."""
        return self.failures <= 3 + 0.001 * self.steps

    def __str__(self) -> str:
        return f"{plural(self.failures, 'time')} in {plural(self.steps, 'env step')}"

    def observe(
        self, predicted_safe: bool | None, unsafe: bool, last: bool, env_index: int = 0
    ) -> bool:
        """Process an env step; return whether the lookahead failed.

        `predicted_safe` is None for an action that the model does not know, which invalidates
        earlier predictions; `unsafe` is what was observed; `last` the end of the episode;
        `env_index` the environment.
        """
        self.steps += 1
        since = self._since.pop(env_index, None)
        if predicted_safe is None:
            since = None
        elif predicted_safe:
            since = 0
        elif since is not None:
            since += 1
        failed = unsafe and since is not None and since < self._horizon
        self.failures += failed
        if since is not None and not (failed or last):
            self._since[env_index] = since
        return failed

    def cut_off(self, env_index: int = 0) -> None:
        """Note that the episode of an environment goes on no further."""
        self._since.pop(env_index, None)


class VetoPolicy(Declared):
    """Refuses actions that are flagged, too risky, undefined, not applicable or below R_min.

    With `arbiter.veto_horizon=lookahead` it also refuses an action that leads, within the
    lookahead, to a state where every action is flagged or too risky, if another action avoids that
    and the lookahead is reliable. `arbiter.unmodelled` decides on actions that the model does not
    know.

    Args:
        actions: The map between ground and environment actions.
        settings: The settings of the arbiter.
        horizon: Control periods that the planner looks ahead.
        refuses: False for baselines: nothing is refused, and the guarantee of `serp.Arbiter` does
            not hold. Steps are forecast nevertheless, so that what is unsafe is counted.

    Attributes:
        refuses: As given.
        reliability: Counts how often the lookahead failed in training.
        allowed_unknown: `[E]` actions that the model does not know and that may be executed.
        foreseen, unforeseen: Of the steps that were not flagged: the sum of their predicted risks,
            and how many came out unsafe, which agree where the learned risks are calibrated.
        held_back: Env steps of training in which an action that is worth more than the planner's
            choice was left out because of its risk.
        needed_risk: The least risk that would have had to be accepted for all of these in one of
            the episodes that had any; 0: none has ended.
        env_index: Environment, from 0, that the next observed step comes from.
    """

    STATE: ClassVar[Mapping[str, Reader]] = {
        "reliability": part, "held_back": count, "needed_risk": probability,
        "foreseen": within(0.0), "unforeseen": count,
    }  # fmt: skip

    def __init__(
        self,
        actions: ActionMap,
        settings: ArbiterSettings,
        horizon: int = 1,
        *,
        refuses: bool = True,
    ) -> None:
        self._actions = actions
        self._settings = settings
        self.refuses = refuses
        self.reliability = LookaheadReliability(horizon)
        self.held_back, self.needed_risk = 0, 0.0
        self._needed: dict[int, float] = {}
        """Environment → the risk that would have had to be accepted so far in its episode."""
        self.foreseen, self.unforeseen = 0.0, 0
        self.allowed_unknown: Mask = ~actions.modelled & (settings.unmodelled == "allow")
        self.env_index = 0

    @property
    def looks_farther(self) -> bool:
        """Whether actions have to leave ways on beyond the lookahead: once it has failed."""
        ahead = self._settings.veto_horizon == "lookahead" and self.reliability.reliable
        return self.refuses and ahead and self.reliability.failures > 0

    def admissible(self, forecast: ActionForecast) -> Mask:
        """Return `[E]` which actions are not refused."""
        if not self.refuses:
            return np.ones(len(forecast.flags), dtype=np.bool_)
        allowed = forecast.safe
        if self._settings.r_min is not None:
            allowed &= forecast.reward >= self._settings.r_min
        if self._settings.veto_horizon == "lookahead" and self.reliability.reliable:
            # If no modelled action has a safe plan, none is refused for that.
            lasting = forecast.safe_steps == SAFE
            if np.count_nonzero(lasting & self._actions.modelled):
                allowed &= lasting
        return allowed | self.allowed_unknown

    def reason_against(self, forecast: ActionForecast, action: int) -> Reason:
        """Return why an action that is not admissible is refused."""
        if not self._actions.modelled[action]:
            return Reason.UNMODELLED
        flags = int(forecast.flags[action])
        if flags & UNSAFE:
            return Reason.UNSAFE
        if flags & RISKY:
            return Reason.TOO_RISKY
        if flags & UNDEFINED:
            return Reason.UNDEFINED
        if not flags & APPLICABLE:
            return Reason.NOT_APPLICABLE
        r_min = self._settings.r_min
        if r_min is not None and forecast.reward[action] < r_min:
            return Reason.LOW_REWARD
        if self.looks_farther and forecast.safe_steps[action] >= forecast.depth:
            return Reason.FEW_WAYS_ON
        return Reason.UNSAFE_AHEAD

    def account(self) -> str:
        """Return in words how often the lookahead failed, and what follows."""
        counted = self.reliability
        rate = f"{percent((counted.failures + 1) / (counted.steps + 2))} per step"
        text = f"The lookahead failed {counted}; its failure rate is {rate} (Laplace estimate)"
        if self.looks_farther:
            text += ". Actions must now leave two safe continuations beyond the lookahead"
        elif not counted.reliable:
            text += ". Vetoes now consider only the next step"
        return text

    def account_of_risk(self) -> str:
        """Return in words how well risks were predicted, and what they held back; "" for nothing.

        Predicted and observed frequencies are compared in the large, over all steps.
        """
        parts = []
        if self.foreseen or self.unforeseen:
            parts.append(
                "Among the steps that the file did not flag, the learned risks predicted "
                f"{self.foreseen:.1f} unsafe steps; {self.unforeseen:,} were observed"
            )
        if needed := self.needed_risk or min(self._needed.values(), default=0.0):
            parts.append(
                f"In {plural(self.held_back, 'step')}, risk excluded a more valuable action; "
                f"a planner.accepted_risk of {percent(needed)} or more may allow it"
            )
        return ". ".join(parts)

    def cut_off(self) -> None:
        """Note that the episode of the only environment goes on no further."""
        self.reliability.cut_off()
        self._end(0)

    def _end(self, env_index: int) -> None:
        """Note that the episode of an environment has ended."""
        if needed := self._needed.pop(env_index, 0.0):
            self.needed_risk = min(needed, self.needed_risk or needed)

    def observe(self, step: StepRecord) -> bool:
        """Return whether the lookahead failed in an env step of training.

        It failed if something unsafe happened that it had predicted to be avoidable.
        """
        decision = step.decision
        if not decision.unsafe and decision.risk >= 0.0:  # NaN for an unknown action
            self.foreseen += decision.risk
            self.unforeseen += step.unsafe
        if needed := held_back(decision.forecast):
            self._needed[self.env_index] = max(needed, self._needed.get(self.env_index, 0.0))
            self.held_back += 1
        if step.last:
            self._end(self.env_index)
        known = bool(self._actions.modelled[decision.action])
        safe = known and bool(decision.forecast.safe_steps[decision.action] == SAFE)
        return self.refuses and self.reliability.observe(
            safe if known else None, step.unsafe, step.last, self.env_index
        )
