"""Planning again what was recorded: a planner that makes the same choice."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from typing import Final

import numpy as np

from serp.agent.chosen_planner import ChosenPlanner
from serp.agent.counterfactuals import Counterfactuals, counterfactuals
from serp.agent.veto import VetoPolicy
from serp.model.transition_model import Vector
from serp.planning.edges import Bound
from serp.planning.far_sight import FarSightPlanner
from serp.planning.forecast import Forecast
from serp.planning.lookahead import Lookahead
from serp.runs.recording import StoredStep
from serp.runs.run import Run
from serp.tasks.action_map import ActionForecast, ActionMap

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
    learned = "what the newest checkpoint has learned"
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


def other_vetoes_of(
    run: Run,
    step: StoredStep,
    planner: ChosenPlanner,
    ranges: tuple[Vector, Vector],
    whole: Collection[int],
) -> Counterfactuals | None:
    """Return the changes of one fluent with which the proposal of a step is not refused.

    `ranges` and `whole` are those of `counterfactuals`. None where none was refused, or none is
    refused today.
    """
    refused = refusal_of(run, step)
    if refused is None or not refused(planner.forecast(step.state)):
        return None
    return counterfactuals(
        lambda state: refused(planner.forecast(state)), run.model, step.state, ranges, whole=whole,
        called=("allowed", "refused").__getitem__, seconds=_SECONDS,
    )  # fmt: skip
