"""The account of a recorded step: what `serp.explanation` tells of it, and what came of it.

Values are those that were recorded. Causes are those of the file as the run has it. What lies
beyond one control period, and what would have had to differ, is computed by a planner that makes
the same choice in this state, see `serp.review.agreeing`. Where none does, it is left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

from serp.control.decision import Actor, Reason
from serp.explanation.causes import Cause, observed_causes
from serp.explanation.decision import Explanation, explain
from serp.explanation.flips import Flips, flips_of
from serp.model.transition_model import StateError
from serp.planning.limits import Bound
from serp.review.agreeing import agreeing_planner, refusal_of
from serp.review.place_in_run import FoundStep, clock
from serp.review.predictions import PredictedFluent, predictions_of
from serp.review.run_model import RunModel
from serp.runs.recording import Recording, StoredStep

_REFUSAL: Final = ("allowed", "refused")
_SECONDS: Final = 4.0
"""Time that planning again may take, and the search for what would have had to differ."""


@dataclass(frozen=True)
class StepAccount:
    """The account of a recorded step.

    Attributes:
        step: Env steps before it; of an evaluation, steps.
        episode, number: Its episode and its number in it, from 1.
        time: Time since the episode began, such as `3:12.4`.
        because: Why this step was chosen; empty where it was asked for.
        executed, proposed: Names of actions; `proposed` is empty where there was no proposal.
        executed_by, proposed_by, reason: As in `decisions.csv`.
        vetoed: Whether a proposal was refused.
        rho: ρ at this step; NaN if unknown.
        indifferent: Whether all plans were worth the same to the planner.
        bound: What ended the planner's sight.
        account: Alternatives with the recorded values, causes and runner-up.
        admissible: Of each alternative, whether no veto refused it.
        planned: Name of the planner's choice; empty where it had none.
        ahead_by: With what it was planned again, for what lies ahead and what would have had to
            differ; empty where nothing makes the same choice.
        choice_flips: Changes of one fluent with which the planner chooses another action.
        veto_flips: Changes of one fluent with which the proposal would not have been refused.
        predictions: The fluents, the largest error first; empty where the next state is unknown.
        reward: The environment's reward.
        predicted_reward: The predicted reward of the file; None where it predicts none.
        domain_reward: The reward that the file as written gives for what was observed; None where
            the next state is unknown, or the file cannot judge it.
        observed: What of the file is behind that, and behind an unsafe step or an end.
        unsafe: Whether what was observed is unsafe by the file.
        terminated, truncated: Whether the episode ended with it, and how.
    """

    step: int
    episode: int
    number: int
    time: str
    because: str
    executed: str
    proposed: str
    executed_by: Actor
    proposed_by: Actor
    reason: Reason
    vetoed: bool
    rho: float
    indifferent: bool
    bound: Bound
    account: Explanation
    admissible: tuple[bool, ...]
    planned: str
    ahead_by: str
    choice_flips: Flips | None
    veto_flips: Flips | None
    predictions: tuple[PredictedFluent, ...]
    reward: float
    predicted_reward: float | None
    domain_reward: float | None
    observed: tuple[Cause, ...]
    unsafe: bool
    terminated: bool
    truncated: bool

    def as_dict(self) -> dict[str, Any]:
        """Return JSON values (infinities and NaN among them)."""
        told = asdict(replace(self, account=None))  # type: ignore[arg-type]
        return {
            **told,
            "account": self.account.as_dict(),
            **{name: str(told[name]) for name in ("executed_by", "proposed_by", "reason")},
        }


def account_of_step(
    run: RunModel, recording: Recording, found: FoundStep, *, search: bool = True
) -> StepAccount:
    """Return the account of a recorded step.

    Args:
        run: The run.
        recording: The recording, of the run or of an evaluation of it.
        found: The step.
        search: Whether it is searched what would have had to differ, which takes up to 8 s in large
            domains.

    Raises:
        RunError: There is no such step, or its recording is damaged.
    """
    step = recording.step(found.step)
    decision, names = step.decision, recording.layout.actions
    forecast = decision.forecast
    ground: list[int] = forecast.ground.tolist()
    planner = agreeing_planner(run, step)
    paths = None
    if planner is not None:
        ahead = planner.paths(step.state, _SECONDS)
        paths = [ahead[g] if g >= 0 else [] for g in ground]
    choice_flips = veto_flips = None
    if search and planner is not None:
        again = planner.forecast
        where = run.model, step.state, recording.ranges
        choice_flips = flips_of(
            lambda s: again(s).choice, *where, whole=recording.whole, called=_action_of(run),
            seconds=_SECONDS,
        )  # fmt: skip
        refused = refusal_of(run, step)
        if refused is not None and refused(again(step.state)):
            veto_flips = flips_of(
                lambda s: refused(again(s)), *where, whole=recording.whole,
                called=_REFUSAL.__getitem__, seconds=_SECONDS,
            )  # fmt: skip
    model = run.adapted or run.model  # risks that were learned are traced in it
    if planner is not None:
        model = planner.model
    account = explain(
        model, step.state, forecast, decision.action,
        names=names, ground=ground, paths=paths, discount=run.settings.planner.discount,
    )  # fmt: skip
    observed, domain_reward, unsafe = _judged(run, step, ground[decision.action])
    return StepAccount(
        step=step.step,
        episode=step.episode,
        number=step.number,
        time=clock((step.number - 1) * recording.layout.control_period),
        because=found.because,
        executed=names[decision.action],
        proposed=names[decision.proposed] if decision.proposed >= 0 else "",
        executed_by=decision.executed_by,
        proposed_by=decision.proposed_by,
        reason=decision.reason,
        vetoed=decision.vetoed,
        rho=decision.rho,
        bound=decision.forecast.bound,
        indifferent=decision.indifferent,
        account=account,
        admissible=tuple(decision.admissible.tolist()),
        planned=names[forecast.choice] if forecast.choice >= 0 else "",
        ahead_by="" if planner is None else planner.called,
        choice_flips=choice_flips,
        veto_flips=veto_flips,
        predictions=tuple(predictions_of(run, recording, step)),
        reward=step.env_reward,
        predicted_reward=account.alternatives[decision.action].reward,
        domain_reward=domain_reward,
        observed=tuple(observed),
        unsafe=unsafe,
        terminated=step.terminated,
        truncated=step.truncated,
    )  # fmt: skip


def _action_of(run: RunModel) -> Callable[[int], str]:
    names = [action.name for action in run.model.actions]
    return lambda position: names[position] if position >= 0 else "no action"


def _judged(run: RunModel, step: StoredStep, ground: int) -> tuple[list[Cause], float | None, bool]:
    """Return causes, reward and flag of what was observed, by the file as written."""
    if step.next_state is None:
        return [], None, step.unsafe
    try:
        causes, judged = observed_causes(run.model, step.state, ground, step.next_state)
    except StateError:
        return [], None, step.unsafe
    return causes, judged.reward, judged.unsafe or step.unsafe
