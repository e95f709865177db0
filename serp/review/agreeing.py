"""Planning again what was recorded: a planner that makes the same choice."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import Final

from serp.model.flags import APPLICABLE, RISKY, UNDEFINED, UNSAFE
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.far_sight.planner import FarSightPlanner
from serp.planning.forecast import SAFE, Forecast
from serp.planning.lookahead import Lookahead
from serp.planning.replanner import MonitorReplanner
from serp.review.run_model import RunModel
from serp.runs.recording import StoredStep
from serp.settings import PlannerSettings

FAR_SIGHT: Final = "far-sight"
_SAME: Final = 1e-9
"""Difference of values, as a share, that is one of rounding."""


class AgreeingPlanner:
    """A planner that makes the recorded choice in a state: the lookahead, or one that sees farther.

    Args:
        model: The model that it plans with.
        settings: The planner's settings.
        called: What it plans with, in words.
        planner: The planner; None: the lookahead.
    """

    def __init__(
        self,
        model: TransitionModel,
        settings: PlannerSettings,
        called: str,
        planner: FarSightPlanner | None = None,
    ) -> None:
        self.model = model
        self.called = called
        self._settings = settings
        self._far = planner
        self._planner = planner or Lookahead(model, settings)

    def forecast(self, state: Vector) -> Forecast:
        """Return what is predicted for every ground action."""
        return self._planner.forecast(state)

    def paths(self, state: Vector, seconds: float) -> list[list[int]]:
        """Return the ground actions, one a control period, of the best path by each action."""
        if self._far is None:
            planner = MonitorReplanner.of(self.model, self._settings, time_budget=seconds)
            return planner.plan(state).paths
        deadline, found = time.monotonic() + seconds, list[list[int]]()
        for action in range(len(self.model.actions)):
            there = time.monotonic() < deadline
            found.append(list(self._followed(state, action)) if there else [])
        return found

    def _followed(self, state: Vector, action: int) -> Iterator[int]:
        """Yield the actions that the planner would choose after an action, as far as its depth."""
        for _ in range(self._settings.depth):
            step = self.model.step(state, action)
            if not step.applicable:
                return
            yield action
            action = -1 if step.terminal else self.forecast(step.state).choice
            if action < 0:
                return
            state = step.state


def agreeing_planner(run: RunModel, step: StoredStep) -> AgreeingPlanner | None:
    """Return a planner that chooses what the planner of the run chose, or None.

    It plans with the file as written, or with what the newest checkpoint has learned. Of several it
    is one that refuses the proposal that was refused, if there is one; then one by which the choice
    is worth most nearly what was recorded.
    """
    forecast = step.decision.forecast
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
        if rank <= (False, _SAME * max(1.0, abs(recorded))):
            break
    return best


def _candidates(run: RunModel) -> Iterator[AgreeingPlanner]:
    settings, learned = run.settings.planner, "what the newest checkpoint has learned"
    yield AgreeingPlanner(run.model, settings, "the file as written")
    if run.adapted is not None:
        yield AgreeingPlanner(run.adapted, settings, learned)
    if settings.name != FAR_SIGHT:
        return
    far = FarSightPlanner(run.model, settings)
    yield AgreeingPlanner(run.model, settings, "the file as written, by far-sight", far)
    if run.has_checkpoint:
        model = run.adaptation.model
        far = FarSightPlanner(model, settings)
        far.visited = run.adaptation.experience
        far.load_state_dict(*run.saved_planner)
        yield AgreeingPlanner(
            model, settings, f"{learned}, and the planner of that checkpoint", far
        )


def refusal_of(run: RunModel, step: StoredStep) -> Callable[[Forecast], int] | None:
    """Return a function of a forecast: 1 where vetoes refuse the proposal of a step, else 0.

    None where no proposal was refused, or the domain does not mention it.
    """
    decision, settings = step.decision, run.settings.arbiter
    ground = int(decision.forecast.ground[decision.proposed]) if decision.vetoed else -1
    if ground < 0:
        return None

    def refused(forecast: Forecast) -> int:
        flags = int(forecast.flags[ground])
        if not flags & APPLICABLE or flags & (UNSAFE | RISKY | UNDEFINED):
            return 1
        if settings.r_min is not None and forecast.reward[ground] < settings.r_min:
            return 1
        ahead = settings.veto_horizon == "lookahead" and int(forecast.safe_steps.max()) == SAFE
        return int(ahead and int(forecast.safe_steps[ground]) != SAFE)

    return refused
