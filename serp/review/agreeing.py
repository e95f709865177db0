"""Planning again what was recorded: a lookahead that makes the same choice."""

from __future__ import annotations

import math
from collections.abc import Callable

from serp.model.flags import APPLICABLE, RISKY, UNDEFINED, UNSAFE
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.forecast import SAFE, Forecast
from serp.planning.lookahead import Lookahead
from serp.planning.replanner import MonitorReplanner
from serp.review.run_model import RunModel
from serp.runs.recording import StoredStep
from serp.settings import ArbiterSettings, PlannerSettings


class AgreeingLookahead:
    """A lookahead that makes the recorded choice in a state.

    Args:
        model: The model that it plans with.
        settings: The planner's settings.
        called: What the model is called in messages.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings, called: str) -> None:
        self.called = called
        self._model = model
        self._settings = settings
        self._lookahead = Lookahead(model, settings)

    def forecast(self, state: Vector) -> Forecast:
        """Return what is predicted for every ground action."""
        return self._lookahead.forecast(state)

    def paths(self, state: Vector, seconds: float) -> list[list[int]]:
        """Return the ground actions, one a control period, of the best path by each action."""
        used = self._settings
        planner = MonitorReplanner(
            self._model, depth=used.depth, discount=used.discount, repeat=used.repeat,
            max_nodes=used.max_nodes, accepted_risk=used.accepted_risk, time_budget=seconds,
        )  # fmt: skip
        return planner.plan(state).paths


def agreeing_lookahead(run: RunModel, step: StoredStep) -> AgreeingLookahead | None:
    """Return a lookahead that chooses what the planner chose, or None.

    It plans with the file as written, or with what the newest checkpoint has learned: with that by
    which the choice is worth more nearly what was recorded.
    """
    forecast = step.decision.forecast
    if forecast.choice < 0:
        return None
    chosen = int(forecast.ground[forecast.choice])
    models = [(run.model, "the file as written")]
    if run.adapted is not None:
        models.append((run.adapted, "what the newest checkpoint has learned"))
    best, nearest = None, math.inf
    for model, called in models:
        lookahead = AgreeingLookahead(model, run.settings.planner, called)
        found = lookahead.forecast(step.state)
        distance = abs(float(found.value[chosen] - forecast.value[forecast.choice]))
        if found.choice == chosen and (best is None or distance < nearest):
            best, nearest = lookahead, distance
    return best


def refusal_by(settings: ArbiterSettings, ground: int) -> Callable[[Forecast], int] | None:
    """Return a function of a forecast: 1 where vetoes refuse a ground action, else 0.

    None for an action that the domain does not mention.
    """
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
