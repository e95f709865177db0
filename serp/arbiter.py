"""Who acts: planner or learner, and what is refused (paper, Algorithm 1).

Guarantee: no action that the model predicts unsafe is executed while one that it does not is
available, whoever proposed it. (Available are the applicable actions, and those that the model does
not know unless they are vetoed.) An action whose result is undefined does not pass for safe: it is
executed only where nothing is predicted safe. Every decision passes `Arbiter.decide` and leaves one
`Decision`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from serp.actions import ActionForecast, ActionMap
from serp.domain.flags import APPLICABLE, UNDEFINED, UNSAFE
from serp.domain.model import TransitionModel, Vector
from serp.errors import SettingsError
from serp.explanation import unsafe_ahead, why_not_applicable, why_unsafe
from serp.planning.forecast import SAFE, Forecast
from serp.quantities import real


class Actor(StrEnum):
    """Who proposed or executed an action."""

    PLANNER = "planner"
    LEARNER = "learner"
    EXPLORATION = "exploration"
    FALLBACK = "fallback"


class Reason(StrEnum):
    """Why the executed action was executed."""

    PLANNER_TURN = "planner's turn"
    ACCEPTED = "proposal accepted"
    NOT_APPLICABLE = "proposal not applicable"
    UNDEFINED = "proposal has no defined result"
    UNSAFE = "proposal predicted unsafe"
    UNSAFE_AHEAD = "proposal leads to where all is predicted unsafe"
    LOW_REWARD = "proposal predicted below R_min"
    UNMODELLED = "proposal unknown to the model"
    NO_SAFE_ACTION = "every action is predicted unsafe"
    NO_APPLICABLE_ACTION = "no action of the model is applicable"


class Proposed(Protocol):
    """What a learner proposes: an environment action, whether it was explored, and why."""

    @property
    def action(self) -> int:
        """Environment action."""

    @property
    def exploratory(self) -> bool:
        """Whether it was drawn at random."""

    @property
    def q(self) -> NDArray[np.floating[Any]] | None:
        """`[E]` what each action promises in the learner's eyes; None where it was drawn."""


Propose = Callable[[NDArray[np.bool_] | None], Proposed]


class Forecaster(Protocol):
    """What the arbiter needs of a planner; `Lookahead` is one."""

    def forecast(self, state: Vector) -> Forecast:
        """Return the planner's view of a state."""


@dataclass(frozen=True, kw_only=True)
class ArbiterSettings:
    """Settings of the mixture of planner and learner.

    Attributes:
        rho: Learner probability ρ at the start, in [0, 1].
        rho_increment: Δρ, what ρ gains at the end of each unit.
        rho_unit: `step`, `episode`, or the name of a counter in the environment's `info`
            (such as `game`) at whose every change ρ grows.
        rho_max: Largest ρ.
        r_min: R_min: a proposal with a smaller predicted reward is refused; None refuses none.
        veto_horizon: `step` refuses what the next step predicts; `lookahead` also refuses what
            leads within the lookahead to where every action is predicted unsafe, while another
            action does not.
        exploration_slack: None: the learner explores among all actions, and vetoes follow. A
            number: it explores only among the admissible actions whose best plan is worth no less
            than the best plan minus this (infinity: among all admissible ones).
        after_veto: Who acts where a greedy proposal is refused: `planner` (Algorithm 1), or
            `learner`: of the admissible actions, the one that the learner values most. An explored
            one is always followed by the planner.
        unmodelled: What to do with environment actions that the domain does not mention.
        indifferent: Who acts in the planner's turn where all plans are worth the same: `first`
            takes the first action in the file, `learner` asks the learner.
    """

    rho: float = 0.0
    rho_increment: float = 0.01
    rho_unit: str = "episode"
    rho_max: float = 1.0
    r_min: float | None = None
    veto_horizon: Literal["step", "lookahead"] = "lookahead"
    exploration_slack: float | None = None
    after_veto: Literal["planner", "learner"] = "planner"
    unmodelled: Literal["allow", "veto"] = "allow"
    indifferent: Literal["first", "learner"] = "learner"

    def __post_init__(self) -> None:
        for name in ("rho", "rho_max", "rho_increment"):
            share = real(getattr(self, name))
            if share is None or not 0.0 <= share <= 1.0:
                raise SettingsError(
                    f"arbiter: {name} must be in [0, 1], not {getattr(self, name)!r}"
                )
            object.__setattr__(self, name, share)
        if self.rho > self.rho_max:
            raise SettingsError(
                f"arbiter: rho starts at {self.rho!r}, above its maximum rho_max {self.rho_max!r}"
            )
        if self.r_min is not None:
            r_min = real(self.r_min)
            if r_min is None:
                raise SettingsError(f"arbiter: r_min must be a number or none, not {self.r_min!r}")
            object.__setattr__(self, "r_min", r_min)
        if not isinstance(self.rho_unit, str):
            raise SettingsError(f"arbiter: rho_unit must be a name, not {self.rho_unit!r}")
        if self.exploration_slack is not None:
            slack = real(self.exploration_slack, infinite=True)
            if slack is None or slack < 0:
                raise SettingsError(
                    f"arbiter: exploration_slack must be >= 0, not {self.exploration_slack!r}"
                )
            object.__setattr__(self, "exploration_slack", slack)
        for name, allowed in (
            ("veto_horizon", ("step", "lookahead")),
            ("after_veto", ("planner", "learner")),
            ("unmodelled", ("allow", "veto")),
            ("indifferent", ("first", "learner")),
        ):
            if getattr(self, name) not in allowed:
                raise SettingsError(
                    f"arbiter: {name} must be {' or '.join(allowed)}, not {getattr(self, name)!r}"
                )


class Decision(NamedTuple):
    """The record of one decision. Actions are environment actions.

    Attributes:
        action: What is executed.
        executed_by: Whose action it is; FALLBACK where neither planner nor learner had one.
        reason: Why.
        proposed: What was proposed; -1 where the planner had no action to propose.
        proposed_by: By whom.
        rho: ρ at that moment.
        predicted_reward: Predicted reward of the executed action, one step; NaN where the model
            does not know it or it is not applicable.
        unsafe: Whether the executed action is predicted unsafe.
        proposal_unsafe: Whether the proposed action is predicted unsafe.
        admissible: `[E]` actions that no veto refuses; all False where every one is refused.
        forecast: The planner's view of the state.
    """

    action: int
    executed_by: Actor
    reason: Reason
    proposed: int
    proposed_by: Actor
    rho: float
    predicted_reward: float
    unsafe: bool
    proposal_unsafe: bool
    admissible: NDArray[np.bool_]
    forecast: ActionForecast

    @property
    def vetoed(self) -> bool:
        """Whether a proposal of the learner was refused."""
        return self.proposed_by is not Actor.PLANNER and self.reason is not Reason.ACCEPTED


class Arbiter:
    """Mixes planner and learner and keeps refused actions from being executed.

    Args:
        planner: Where forecasts come from, usually a `Lookahead`.
        actions: The map between ground and environment actions.
        settings: See `ArbiterSettings`.
        seed: Seed of the draws "planner or learner?".
    """

    def __init__(
        self,
        planner: Forecaster,
        actions: ActionMap,
        settings: ArbiterSettings | None = None,
        seed: int | np.random.SeedSequence = 0,
    ) -> None:
        self.planner = planner
        self.actions = actions
        self.settings = settings or ArbiterSettings()
        self.rho = self.settings.rho
        self._random = np.random.default_rng(seed)
        self._unmodelled_allowed = (
            ~actions.modelled
            if self.settings.unmodelled == "allow"
            else np.zeros(actions.size, dtype=np.bool_)
        )

    @property
    def model(self) -> TransitionModel:
        """The transition model."""
        return self.actions.model

    def end_unit(self, unit: str) -> None:
        """Let ρ grow if it grows by this unit."""
        if unit == self.settings.rho_unit:
            self.rho = min(self.settings.rho_max, self.rho + self.settings.rho_increment)

    def forecast(self, state: Vector) -> ActionForecast:
        """Return the planner's view of a state `[F]` in terms of environment actions."""
        return self.actions.project(self.planner.forecast(state))

    def admissible(self, forecast: ActionForecast) -> NDArray[np.bool_]:
        """Return `[E]` which actions no veto refuses."""
        allowed = forecast.safe
        if self.settings.r_min is not None:
            allowed &= forecast.reward >= self.settings.r_min
        if self.settings.veto_horizon == "lookahead":
            # Against the best that the model knows: where all is lost, nothing is refused for it.
            known = forecast.safe_steps[self.actions.modelled]
            if known.size and known.max() == SAFE:
                allowed &= forecast.safe_steps == SAFE
        return allowed | self._unmodelled_allowed

    def decide(self, state: Vector, propose: Propose) -> Decision:
        """Decide what to do in a state.

        Args:
            state: Monitored state `[F]`.
            propose: Asked for the learner's proposal when it is the learner's turn; its argument
                is the mask `[E]` of actions to explore among, or None for all.
        """
        forecast = self.forecast(state)
        admissible = self.admissible(forecast)
        planners_turn = self._random.random() > self.rho
        if planners_turn and not (forecast.indifferent and self.settings.indifferent == "learner"):
            return self._planners_turn(forecast, admissible)
        proposal = propose(self._explorable(forecast, admissible))
        return self._consider(forecast, admissible, proposal)

    def judge_proposal(self, state: Vector, proposal: Proposed) -> Decision:
        """Decide on a proposal whatever ρ is: it is executed, or refused and the planner acts."""
        forecast = self.forecast(state)
        return self._consider(forecast, self.admissible(forecast), proposal)

    def let(self, state: Vector, proposal: Proposed) -> Decision:
        """Record a proposal that is executed whatever the model says of it.

        It measures a learner alone: there is no veto, and the guarantee does not hold.
        """
        forecast = self.forecast(state)
        return self._accept(forecast, self.admissible(forecast), proposal)

    def plan(self, state: Vector) -> Decision:
        """Let the planner act, whatever ρ is."""
        forecast = self.forecast(state)
        return self._planners_turn(forecast, self.admissible(forecast))

    # Who acts ----------------------------------------------------------------------------------

    def _planners_turn(self, forecast: ActionForecast, admissible: NDArray[np.bool_]) -> Decision:
        action = forecast.choice
        return self._planner_acts(forecast, admissible, action, Actor.PLANNER, Reason.PLANNER_TURN)

    def _consider(
        self, forecast: ActionForecast, admissible: NDArray[np.bool_], proposal: Proposed
    ) -> Decision:
        actor, action = _proposer(proposal), int(proposal.action)
        if admissible[action]:
            return self._accept(forecast, admissible, proposal)
        refusal = self._refusal(forecast, action)
        if self.settings.after_veto == "learner" and proposal.q is not None and admissible.any():
            second = int(np.where(admissible, proposal.q, -np.inf).argmax())
            return self._record(forecast, admissible, second, actor, refusal, action, actor)
        return self._planner_acts(forecast, admissible, action, actor, refusal)

    def _accept(
        self, forecast: ActionForecast, admissible: NDArray[np.bool_], proposal: Proposed
    ) -> Decision:
        actor, action = _proposer(proposal), int(proposal.action)
        return self._record(forecast, admissible, action, actor, Reason.ACCEPTED, action, actor)

    def _explorable(
        self, forecast: ActionForecast, admissible: NDArray[np.bool_]
    ) -> NDArray[np.bool_] | None:
        slack = self.settings.exploration_slack
        if slack is None:
            return None
        if slack == np.inf or not admissible.any():
            return admissible
        good = forecast.value >= forecast.value[admissible].max() - slack
        explorable: NDArray[np.bool_] = admissible & (good | ~self.actions.modelled)
        return explorable

    def _refusal(self, forecast: ActionForecast, action: int) -> Reason:
        if not self.actions.modelled[action]:
            return Reason.UNMODELLED
        flags = int(forecast.flags[action])
        if flags & UNSAFE:
            return Reason.UNSAFE
        if flags & UNDEFINED:
            return Reason.UNDEFINED
        if not flags & APPLICABLE:
            return Reason.NOT_APPLICABLE
        r_min = self.settings.r_min
        if r_min is not None and forecast.reward[action] < r_min:
            return Reason.LOW_REWARD
        return Reason.UNSAFE_AHEAD

    def _planner_acts(
        self,
        forecast: ActionForecast,
        admissible: NDArray[np.bool_],
        proposed: int,
        proposed_by: Actor,
        reason: Reason,
    ) -> Decision:
        action, executed_by = forecast.choice, Actor.PLANNER
        if action < 0 or forecast.flags[action] & UNSAFE:
            reason = Reason.NO_APPLICABLE_ACTION if action < 0 else Reason.NO_SAFE_ACTION
            instead = self._least_evil(forecast, proposed, otherwise=action)
            if instead != action:
                action, executed_by = instead, Actor.FALLBACK
        return self._record(
            forecast, admissible, action, executed_by, reason, proposed, proposed_by
        )

    def _least_evil(self, forecast: ActionForecast, proposed: int, otherwise: int) -> int:
        """Return what is done where no action is safe; `otherwise` is the planner's, or -1.

        What the model does not know comes before what it cannot predict, and that before what it
        predicts unsafe. What cannot be done comes last; of equals, what was proposed.
        """
        unpredicted = (forecast.flags & (UNDEFINED | UNSAFE)) == UNDEFINED
        kinds = [self._unmodelled_allowed, unpredicted]
        if otherwise < 0:
            kinds.append((forecast.flags == 0) & self.actions.modelled)
        for kind in kinds:
            if kind.any():
                return proposed if proposed >= 0 and kind[proposed] else int(kind.argmax())
        return otherwise if otherwise >= 0 else max(proposed, 0)

    def _record(
        self,
        forecast: ActionForecast,
        admissible: NDArray[np.bool_],
        action: int,
        executed_by: Actor,
        reason: Reason,
        proposed: int,
        proposed_by: Actor,
    ) -> Decision:
        flags = int(forecast.flags[action])
        return Decision(
            action=action,
            executed_by=executed_by,
            reason=reason,
            proposed=proposed,
            proposed_by=proposed_by,
            rho=self.rho,
            predicted_reward=float(forecast.reward[action]) if flags & APPLICABLE else np.nan,
            unsafe=bool(flags & UNSAFE),
            proposal_unsafe=proposed >= 0 and bool(forecast.flags[proposed] & UNSAFE),
            admissible=admissible,
            forecast=forecast,
        )

    # Explaining --------------------------------------------------------------------------------

    def explain(self, decision: Decision, state: Vector) -> str:
        """Say in the words of the domain file what is wrong with what was proposed.

        Empty where the proposal, the planner's or the learner's, was fine and was executed.
        """
        if decision.reason in (Reason.PLANNER_TURN, Reason.ACCEPTED):
            return ""
        shown = decision.proposed if decision.proposed >= 0 else decision.action
        ground = int(decision.forecast.ground[shown])
        if ground < 0:
            return f"{self.actions.name(shown)}: the domain does not mention it"
        flags = int(decision.forecast.flags[shown])
        if not flags & APPLICABLE:
            return why_not_applicable(self.model, state, ground)
        if flags & UNSAFE:
            return why_unsafe(self.model, state, ground)
        name = self.model.actions[ground].name
        if decision.reason is Reason.LOW_REWARD:
            return (
                f"{name}: predicted reward {decision.forecast.reward[shown]:.4g} is below "
                f"R_min {self.settings.r_min:g}"
            )
        steps = int(decision.forecast.safe_steps[shown])
        return f"{name}: {unsafe_ahead(steps)}"

    # State -------------------------------------------------------------------------------------

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        return {}, {"rho": self.rho, "random": self._random.bit_generator.state}

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned."""
        self.rho = float(meta["rho"])
        self._random.bit_generator.state = dict(meta["random"])


def _proposer(proposal: Proposed) -> Actor:
    return Actor.EXPLORATION if proposal.exploratory else Actor.LEARNER
