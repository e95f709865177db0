"""The account of a recorded step: what `serp.explanation` tells of it, and what came of it.

Values are those that were recorded. Causes are those of the file as the run has it. What lies
beyond one control period, and what would have had to differ, is computed by a planner that makes
the same choice in this state, see `serp.runs.agreeing`. Where none does, it is left out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp.agent.causes import Cause, observed_causes
from serp.agent.counterfactuals import Counterfactuals, counterfactuals
from serp.agent.decision import Actor, Reason
from serp.agent.explanation import Explanation, explain
from serp.errors import RunError
from serp.model.learned.regression_data import predictions
from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.planning.edges import Bound
from serp.runs.agreeing import RunModel, agreeing_planner, refusal_of
from serp.runs.recording import REASONS, VETO_COLUMNS, Recording, StoredStep, vetoed

_ROUNDING: Final = 1e-6
"""Error, in units, up to which a prediction is right."""


@dataclass(frozen=True)
class PredictedFluent:
    """One fluent, predicted one step ahead, and observed.

    Attributes:
        fluent: Its name.
        before: Its value before the step.
        predicted: What the file as written predicts; None where it predicts nothing.
        observed: Its value after the step.
        error: Observed less predicted, in units of what the fluent usually changes by in a step
            (root mean square over the recording); infinite where it never changes, of a predicate
            1 where it is not as predicted.
        learned: What the model of the newest checkpoint predicts, where that is something else.
    """

    fluent: str
    before: float | bool
    predicted: float | bool | None
    observed: float | bool
    error: float
    learned: float | bool | None = None


def predictions_of(run: RunModel, recording: Recording, step: StoredStep) -> list[PredictedFluent]:
    """Return what was predicted for a step and what came of it, the largest error first."""
    ground, model = int(step.decision.forecast.ground[step.decision.action]), run.model
    written = _predicted(model, step.state, ground)
    adapted = run.adapted
    learned = None if adapted is None else _predicted(adapted, step.state, ground)
    found = []
    for k, fluent in enumerate(model.fluents):
        shown: Callable[[float], float | bool] = float if fluent.numeric else bool
        observed = float(step.next_state[k])
        error = 0.0
        if written is not None and observed != written[k]:
            error, usual = observed - float(written[k]), float(recording.usual_change[k])
            if not fluent.numeric:
                error = 1.0
            else:
                error = error / usual if usual > 0.0 else math.copysign(math.inf, error)
        other = learned is not None and written is not None and learned[k] != written[k]
        found.append(
            PredictedFluent(
                fluent.name,
                shown(float(step.state[k])),
                None if written is None else shown(float(written[k])),
                shown(observed),
                error,
                shown(float(learned[k])) if other and learned is not None else None,
            )
        )
    return sorted(found, key=lambda each: -abs(each.error))


def _predicted(model: TransitionModel, state: Vector, ground: int) -> Vector | None:
    if ground < 0:
        return None
    step = model.step(state, ground)
    return step.state if step.applicable else None


def predicted_states(model: TransitionModel, states: Vector, actions: NDArray[np.int64]) -> Vector:
    """Return the states `[n, F]` one step ahead; NaN where the model predicts none.

    Args:
        model: The model.
        states: `[n, F]`.
        actions: `[n]` ground actions; -1 where the model does not know the action.
    """
    found, known = np.full_like(states, np.nan), actions >= 0
    if known.any():
        found[known] = predictions(model, states[known], actions[known])
    return found


def error_units(model: TransitionModel, usual: Vector, predicted: Vector) -> Vector:
    """Return the units `[F]` of errors one step ahead; those of predicates are 1.

    Args:
        model: The model.
        usual: What each fluent usually changes by in a step (root mean square).
        predicted: What it is predicted to change by, which counts where it never changes.
    """
    numeric = np.array([fluent.numeric for fluent in model.fluents], np.bool_)
    units = np.where(usual > 0.0, usual, predicted)
    return np.where(numeric & (units > 0.0), units, 1.0)


def in_units(differences: Vector, units: Vector) -> Vector:
    """Return the sizes of errors in units; rounding is no error."""
    errors = np.abs(differences) / units
    errors[errors < _ROUNDING] = 0.0
    return errors


_TIME: Final = re.compile(r"(?:(?:(\d+):)?(\d+):)?(\d+(?:\.\d+)?)")
_LARGEST: Final = 1e12


class FoundStep(NamedTuple):
    """A step of a recording, and why it is shown; empty where it was asked for."""

    step: int
    because: str = ""


def most_telling(recording: Recording) -> FoundStep:
    """Return the step of the newest veto; without one the newest unsafe step, else the last one.

    A veto for harm, risk or reward tells more than one of a proposal that is not applicable.

    Raises:
        RunError: There is no step yet.
    """
    columns = recording.columns(*VETO_COLUMNS, "unsafe")
    refused = vetoed(columns)
    applicable = columns["reason"] != REASONS.index(Reason.NOT_APPLICABLE)
    for what, steps in (
        ("refused proposal that was applicable", refused & applicable),
        ("unsafe step", columns["unsafe"]),
        ("refused proposal", refused),
    ):
        if steps.any():
            return FoundStep(int(np.flatnonzero(steps)[-1]), f"the last {what}")
    if not len(recording):
        recording.step(0)  # raises
    return FoundStep(len(recording) - 1, "the last step: nothing was refused, and nothing unsafe")


def seconds_of(text: str) -> float:
    """Return a time in seconds: `12.5`, `3:12`, `1:03:12`.

    Raises:
        RunError: It is no time.
    """
    match = _TIME.fullmatch(text.strip())
    if match is None:
        raise RunError(f"`{text}` is no time; write minutes:seconds, such as 3:12 or 1:03:12.5")
    hours, minutes, seconds = (float(part or 0) for part in match.groups())
    return min(_LARGEST, 3600 * hours + 60 * minutes + seconds)


def step_at(recording: Recording, episode: int, seconds: float) -> FoundStep:
    """Return the step of an episode in which a time falls, counted from the episode's beginning.

    Raises:
        RunError: There is no such episode, or it has ended by then.
    """
    period = recording.layout.control_period
    number = int(seconds / period + 1e-9) + 1
    recording.find(episode, 1)  # or there is no such episode
    count = len(recording.episodes[episode])
    if number > count:
        raise RunError(
            f"episode {episode:,} ends after {clock(count * period)} ({count:,} steps of "
            f"{period:g} s)."
        )
    return FoundStep(recording.find(episode, number))


def clock(seconds: float) -> str:
    """Return seconds as `3:12`, `1:03:12` or, where they are not whole, `3:12.46`."""
    hundredths = round(100 * seconds)
    minutes, rest = divmod(hundredths, 6000)
    hours, minutes = divmod(minutes, 60)
    text = f"{rest // 100:02}" + (f".{rest % 100:02}".rstrip("0") if rest % 100 else "")
    return f"{hours}:{minutes:02}:{text}" if hours else f"{minutes}:{text}"


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
        other_choices: Changes of one fluent with which the planner chooses another action.
        other_vetoes: Changes of one fluent with which the proposal would not have been refused.
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
    other_choices: Counterfactuals | None
    other_vetoes: Counterfactuals | None
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
    other_choices = other_vetoes = None
    if search and planner is not None:
        again = planner.forecast
        where = run.model, step.state, recording.ranges
        other_choices = counterfactuals(
            lambda s: again(s).choice, *where, whole=recording.whole, called=_action_of(run),
            seconds=_SECONDS,
        )  # fmt: skip
        refused = refusal_of(run, step)
        if refused is not None and refused(again(step.state)):
            other_vetoes = counterfactuals(
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
        other_choices=other_choices,
        other_vetoes=other_vetoes,
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
    try:
        causes, judged = observed_causes(run.model, step.state, ground, step.next_state)
    except StateError:
        return [], None, step.unsafe
    return causes, judged.reward, judged.unsafe or step.unsafe
