"""The account of a recorded step: what `serp.agent.explanation` tells of it, and what came of it.

Values are those that were recorded. Causes are those of the file as the run has it. What lies
beyond one control period, and what would have had to differ, is computed by a planner that makes
the same choice in this state, see `agreeing_planner`. Where none does, it is left out.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.text import percent, plural, readable
from serp.agent.causes import Cause, observed_causes
from serp.agent.chosen_planner import ChosenPlanner
from serp.agent.counterfactuals import Counterfactuals, counterfactuals
from serp.agent.decision import Reason
from serp.agent.explanation import Explanation, explain
from serp.agent.sentences import lines_of_causes, lines_of_changes, who_decided, why_refused
from serp.agent.veto import VetoPolicy
from serp.model.learned.regression_data import predictions
from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.planning.far_sight import FarSightPlanner
from serp.planning.forecast import Bound, Forecast
from serp.planning.lookahead import Lookahead
from serp.runs.recording import REASONS, VETO_COLUMNS, Recording, StoredStep, vetoed
from serp.runs.run import Run
from serp.tasks.action_map import ActionForecast, ActionMap


def unsafe_steps(recording: Recording, most: int = 5) -> str:
    """Return the numbers of the newest unsafe steps, for `serp why --step`; empty for none."""
    steps = np.flatnonzero(recording.columns("unsafe")["unsafe"]).tolist()
    newest = ", ".join(map(str, steps[-most:]))
    return f" ({'the last: ' if len(steps) > most else ''}step {newest})" if steps else ""


@dataclass(frozen=True)
class PredictedFluent:
    """One fluent, predicted one step ahead, and observed."""

    fluent: str
    before: float | bool
    predicted: float | bool | None  # by the file as written, if it predicts anything
    observed: float | bool
    error: float  # in the units of `error_units`; 0 where nothing is predicted
    learned: float | bool | None = None  # by the newest checkpoint, where that is something else


def predictions_of(run: Run, recording: Recording, step: StoredStep) -> list[PredictedFluent]:
    """Return what was predicted for a step and what came of it, the largest error first."""
    model = run.model
    before, after = model.values(step.state), model.values(step.next_state)
    ground = int(step.decision.forecast.ground[step.decision.action])
    written, learned = (
        {} if each is None or ground < 0 else _predicted(each, step.state, ground)
        for each in (model, run.adapted)
    )
    expected = np.array([float(written.get(name, after[name])) for name in after])
    units = error_units(model, recording.usual_change, np.abs(expected - step.state))
    errors = in_units(step.next_state - expected, units).tolist()
    found = []
    for (name, observed), error in zip(after.items(), errors, strict=True):
        predicted, other = written.get(name), learned.get(name)
        other = None if predicted is None or other == predicted else other
        found.append(PredictedFluent(name, before[name], predicted, observed, error, other))
    return sorted(found, key=lambda each: -each.error)


def _predicted(model: TransitionModel, state: Vector, ground: int) -> dict[str, float | bool]:
    step = model.step(state, ground)
    return model.values(step.state) if step.applicable else {}


def predicted_states(model: TransitionModel, states: Vector, actions: NDArray[np.int64]) -> Vector:
    """Return the states `[n, F]` one step ahead; NaN where there is none, or no action (-1)."""
    found, known = np.full_like(states, np.nan), actions >= 0
    if known.any():
        found[known] = predictions(model, states[known], actions[known])
    return found


def error_units(model: TransitionModel, usual: Vector, predicted: Vector) -> Vector:
    """Return the units `[F]` of errors one step ahead; those of predicates are 1.

    They are the usual change of each fluent in a step (root mean square), or the predicted one.
    """
    numeric = np.array([fluent.numeric for fluent in model.fluents], np.bool_)
    units = np.where(usual > 0.0, usual, predicted)
    return np.where(numeric & (units > 0.0), units, 1.0)


def in_units(differences: Vector, units: Vector) -> Vector:
    """Return the sizes of errors in units; rounding is no error."""
    errors = np.abs(differences) / units
    errors[errors < 1e-6] = 0.0
    return errors


def most_telling(recording: Recording) -> tuple[int, str]:
    """Return the step of the newest veto, and why it is shown.

    Without a veto it is the newest unsafe step, else the last one; without any, a RunError. A veto
    for harm, risk or reward tells more than one of a proposal that is not applicable.
    """
    columns = recording.columns(*VETO_COLUMNS, "unsafe", "proposed", "action")
    refused = vetoed(columns) & (columns["proposed"] != columns["action"])
    applicable = columns["reason"] != REASONS.index(Reason.NOT_APPLICABLE)
    for what, steps in (
        ("refused proposal that was applicable", refused & applicable),
        ("unsafe step", columns["unsafe"]),
        ("refused proposal", refused),
    ):
        if steps.any():
            return int(np.flatnonzero(steps)[-1]), f"the last {what}"
    if not len(recording):
        recording.step(0)  # raises
    return len(recording) - 1, "the last step, because nothing was refused or unsafe"


@dataclass(frozen=True)
class StepAccount:
    """The account of a recorded step.

    Attributes:
        account: Alternatives with the recorded values, causes and runner-up.
        was_planned: Whether the planner planned. If not, it only checked which actions are safe,
            and the forecast of the step is that of `ahead_by`.
        ahead_by: With what it was planned again, for what lies ahead and what would have had to
            differ; empty where nothing makes the same choice.
        other_choices, other_vetoes: Changes of one fluent with which the planner chooses another
            action, or with which the proposal would not have been refused.
        predictions: The fluents, the largest error first; empty where the next state is unknown.
        domain_reward: The reward that the file as written gives for what was observed; None where
            the next state is unknown, or the file cannot judge it.
        observed: What of the file is behind that, and behind an unsafe step or an end.
    """

    step: StoredStep
    account: Explanation
    was_planned: bool
    ahead_by: str
    other_choices: Counterfactuals | None
    other_vetoes: Counterfactuals | None
    predictions: tuple[PredictedFluent, ...]
    domain_reward: float | None
    observed: tuple[Cause, ...]
    unsafe: bool

    def name(self, action: int) -> str:
        """Return the name of an action of the environment; empty for none."""
        return self.account.alternatives[action].name if action >= 0 else ""

    @property
    def proposed(self) -> str:
        """The name of the proposed action; empty for none."""
        return self.name(self.step.decision.proposed)

    def as_dict(self) -> dict[str, Any]:
        """Return JSON values (infinities and NaN among them)."""
        step, decision = self.step, self.step.decision
        by = ("executed_by", "proposed_by", "reason")
        of_step = ("step", "episode", "terminated", "truncated")
        own = {each.name: getattr(self, each.name) for each in fields(self)}
        for name in ("other_choices", "other_vetoes"):
            own[name] = own[name] and asdict(own[name])
        for name in ("predictions", "observed"):
            own[name] = [asdict(each) for each in own[name]]
        return own | {
            "account": self.account.as_dict(),
            **{name: getattr(step, name) for name in of_step},
            "number": step.number - 1,
            **{name: str(getattr(decision, name)) for name in by},
            "executed": self.name(decision.action),
            "proposed": self.proposed,
            "planned": self.name(decision.forecast.choice),
            "vetoed": decision.vetoed,
            "rho": decision.rho,
            "indifferent": decision.indifferent,
            "bound": decision.forecast.bound,
            "admissible": decision.admissible.tolist(),
            "reward": step.env_reward,
            "predicted_reward": self.account.alternatives[decision.action].reward,
        }


def account_of_step(run: Run, recording: Recording, step: int) -> StepAccount:
    """Return the account of a step by its position in a recording of the run, or a RunError."""
    stored = recording.step(step)
    decision, state = stored.decision, stored.state
    ground: list[int] = decision.forecast.ground.tolist()
    planner = agreeing_planner(run, stored)
    planned = decision.forecast.bound is not Bound.SAFETY
    if planner is not None and not planned:
        decision = decision._replace(forecast=planned_again(decision.forecast, planner, state))
        stored = replace(stored, decision=decision)
    model = run.adapted or run.model  # risks that were learned are traced in it
    paths = other_choices = other_vetoes = None
    if planner is not None:
        model = planner.model
        ahead = planner.paths(state, planner.plan(state))
        paths = [ahead[g] if g >= 0 else [] for g in ground]
        within = recording.ranges, recording.whole
        other_choices = planner.other_choices(state, *within)
        refused = refusal_of(run, stored)
        if refused is not None and refused(planner.forecast(state)):
            other_vetoes = counterfactuals(
                lambda state: refused(planner.forecast(state)), run.model, state, within[0],
                whole=within[1], called=("allowed", "refused").__getitem__, seconds=_SECONDS,
            )  # fmt: skip
    account = explain(
        model, state, decision.forecast, decision.action,
        names=recording.layout.actions, ground=ground, paths=paths,
        discount=run.made.settings.planner.discount,
    )  # fmt: skip
    observed: list[Cause] = []
    domain_reward, unsafe = None, stored.unsafe
    with contextlib.suppress(StateError):
        own = ground[decision.action]
        observed, judged = observed_causes(run.model, state, own, stored.next_state)
        domain_reward, unsafe = judged.reward, judged.unsafe or unsafe
    return StepAccount(
        step=stored,
        account=account,
        was_planned=planned,
        ahead_by="" if planner is None else planner.name,
        other_choices=other_choices,
        other_vetoes=other_vetoes,
        predictions=tuple(predictions_of(run, recording, stored)),
        domain_reward=domain_reward,
        observed=tuple(observed),
        unsafe=unsafe,
    )


_SECONDS: Final = 4.0
"""Time that planning again may take, and the search for what would have had to differ."""


def agreeing_planner(run: Run, step: StoredStep) -> ChosenPlanner | None:
    """Return a planner that chooses what the planner of the run chose, or None.

    It plans with the file as written, or with what the newest checkpoint has learned. Of the two it
    is one that refuses the proposal that was refused, if there is one; then the one by which the
    choice is worth most nearly what was recorded. Where nothing was planned, it is the newest one.
    """
    forecast = step.decision.forecast
    if forecast.bound is Bound.SAFETY:
        return [*_candidates(run)][-1]
    if forecast.choice < 0:
        return None
    chosen = int(forecast.ground[forecast.choice])
    recorded = float(forecast.value[forecast.choice])
    refused = refusal_of(run, step)
    best, rank = None, (True, math.inf)
    for planner in _candidates(run):
        found = planner.forecast(step.state)
        allowed = refused is not None and not refused(found)
        own = allowed, abs(float(found.value[chosen]) - recorded)
        if found.choice == chosen and (best is None or own < rank):
            best, rank = planner, own
        if rank <= (False, 1e-9 * max(1.0, abs(recorded))):
            break
    return best


def planned_again(
    forecast: ActionForecast, planner: ChosenPlanner, state: Vector
) -> ActionForecast:
    """Return the forecast of a step in which only safety was checked, with a planner's plan."""
    found, ground = planner.forecast(state), forecast.ground
    chosen = np.flatnonzero((ground == found.choice) & (ground >= 0))

    def by_action(column: Vector, unknown: float) -> Vector:
        return np.where(ground >= 0, column[ground], unknown)

    return forecast._replace(
        choice=int(chosen[0]) if len(chosen) else -1,
        value=by_action(found.value, -np.inf),
        path_risk=by_action(found.path_risk, 0.0),
        depth=found.depth,
        bound=found.bound,
        indifferent=found.indifferent,
    )


def _candidates(run: Run) -> Iterator[ChosenPlanner]:
    settings = run.made.settings.planner
    make = FarSightPlanner if settings.name == "far-sight" else Lookahead
    written = make(run.model, settings)
    yield ChosenPlanner(written, run.model, settings, "the file as written", seconds=_SECONDS)
    if not run.has_checkpoint or (make is Lookahead and run.adapted is None):
        return
    model = run.adaptation.model
    planner = make(model, settings)
    if isinstance(planner, FarSightPlanner):
        planner.visited = run.adaptation.experience
        planner.load_state_dict(*run.saved_agent.part("planner"))
    learned = "the model of the newest checkpoint"
    yield ChosenPlanner(planner, model, settings, learned, seconds=_SECONDS)


def refusal_of(run: Run, step: StoredStep) -> Callable[[Forecast], int] | None:
    """Return a function of a forecast: 1 where vetoes refuse the proposal of a step, else 0.

    None where no proposal was refused, or the domain does not mention it.
    """
    decision = step.decision
    ground = int(decision.forecast.ground[decision.proposed]) if decision.vetoed else -1
    if ground < 0:
        return None
    actions = ActionMap(run.model, len(run.model.actions))
    vetoes = VetoPolicy(actions, run.made.settings.arbiter)
    return lambda forecast: int(not vetoes.admissible(actions.project(forecast))[ground])


def heading(of: StoredStep) -> str:
    """Return which step it is: `step 1,204 (step 36 of episode 12)`."""
    return f"step {of.step:,} (step {of.number - 1:,} of episode {of.episode:,})"


def who_acted(account: StepAccount) -> list[str]:
    """Say who acted and why."""
    decision, why = account.step.decision, ""
    if decision.proposed >= 0:
        of = account.account.alternatives[decision.proposed]
        why = why_refused(decision.reason, of.causes, of.reward, of.safe_steps)
    lines = who_decided(
        decision.reason,
        (account.proposed, decision.proposed_by),
        (account.name(decision.action), decision.executed_by),
        rho=decision.rho,
        indifferent=decision.indifferent and account.was_planned,
        bound=decision.forecast.bound,
        why=why,
    )
    if not account.was_planned:
        lines.append(
            "The learner led, so the planner only checked which actions are safe. Its plan was "
            f"computed afterwards with {account.ahead_by}."
        )
    return lines


def what_would_differ(account: StepAccount) -> list[str]:
    """Say what would have had to differ for another outcome, and what was searched."""
    vetoes, choices, proposed = account.other_vetoes, account.other_choices, account.proposed
    lines, decision = [], account.step.decision
    refused = decision.vetoed and decision.action != decision.proposed
    if vetoes is not None and refused:
        lines += lines_of_changes(vetoes, f"{proposed} would not have been refused")
    if choices is not None:
        lines += lines_of_changes(choices)
        if refused and vetoes is None:
            lines.append(f"{proposed} is not refused now, because the model has changed since.")
        lines.append(f"{choices.searched} The plans were computed again with {account.ahead_by}.")
    return lines


def prediction_line(each: PredictedFluent) -> str:
    """Return an error of a prediction as a line."""
    line = f"{each.fluent}: {readable(each.predicted)} predicted, "
    line += f"{readable(each.observed)} observed"
    if not isinstance(each.observed, bool):
        line += f", error: {percent(each.error)} of a typical change"
    if each.learned is not None:
        line += f"; the learned model predicts {readable(each.learned)}"
    return line + f" (before: {readable(each.before)})"


def what_came(account: StepAccount) -> list[str]:
    """Compare what was predicted with what was observed, the largest errors first."""
    predictions, step = account.predictions, account.step
    # Up to a twentieth of a usual change a fluent is as predicted.
    wrong = [each for each in predictions if each.error > 0.05]
    if predictions and predictions[0].predicted is None:
        lines = ["The file predicts nothing for this action."]
    elif wrong:
        of = f"{len(wrong)} of {plural(len(predictions), 'fluent')}"
        lines = [f"The file's prediction was wrong for {of}:"]
        lines += [f"  {prediction_line(each)}" for each in wrong]
    else:
        lines = ["Every fluent changed as the file predicts."]
    came = f"The environment gave {readable(step.env_reward)}"
    if step.terminated or step.truncated:
        came += " and the episode ended" + ("" if step.terminated else " (truncated)")
    lines.append(came + ".")
    if step.unsafe:
        flagged = any(cause.what == "unsafe" for cause in account.observed)
        by = "" if flagged else ": the environment reported this, but no line of the file flags it"
        lines.append(f"The step was observed unsafe{by}.")
    if account.domain_reward is None:
        return lines
    expected = account.account.alternatives[step.decision.action].reward
    predicted = "" if expected is None else f" (predicted: {readable(expected)})"
    worth = f"The file's reward for this step is {readable(account.domain_reward)}{predicted}"
    lines.append(worth + (":" if account.observed else "."))
    lines += [f"  {line}" for line in lines_of_causes(account.observed)]
    gap = step.env_reward - account.domain_reward
    if not math.isclose(step.env_reward, account.domain_reward, rel_tol=0.01):
        more = "more" if gap > 0 else "less"
        lines.append(f"The environment gave {readable(abs(gap))} {more} than the file says.")
    return lines
