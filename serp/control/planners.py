"""The planners `closed-graph` and `lookahead`, for every size of domain."""

from __future__ import annotations

from serp.control.protocols import Planner
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.far_sight.planner import ClosedGraphPlanner, FarSightPlanner
from serp.planning.forecast import Forecast
from serp.planning.lookahead import Lookahead
from serp.planning.replanner import MonitorReplanner
from serp.settings import PlannerSettings


class GraphPlanner:
    """Forecasts of the planning graph, for domains too large to be compiled.

    Args:
        model: The transition model.
        settings: The settings of the planner.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings) -> None:
        self._replanner = MonitorReplanner(
            model,
            depth=settings.depth,
            discount=settings.discount,
            repeat=settings.repeat,
            max_nodes=settings.max_nodes,
            accepted_risk=settings.accepted_risk,
        )

    def forecast(self, state: Vector) -> Forecast:
        """Return the forecast for a state `[F]`."""
        return self._replanner.plan(state).forecast


def lookahead(model: TransitionModel, settings: PlannerSettings) -> Planner:
    """Return the faster lookahead that supports a model; both give the same decisions."""
    return Lookahead(model, settings) if model.compiles else GraphPlanner(model, settings)


def closed_graph(model: TransitionModel, settings: PlannerSettings) -> Planner:
    """Return the planner that sees to the end of a finite task."""
    near = lookahead(model, settings)
    if isinstance(near, Lookahead):
        return FarSightPlanner(model, settings, near)
    return ClosedGraphPlanner(model, settings, near)
