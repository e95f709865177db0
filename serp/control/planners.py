"""The planners `far-sight` and `lookahead`, for every size of domain."""

from __future__ import annotations

from dataclasses import dataclass

from serp.control.protocols import Planner
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.far_sight.planner import FarSightPlanner
from serp.planning.forecast import Forecast
from serp.planning.graph import PlanningGraph
from serp.planning.lookahead import Lookahead
from serp.settings import PlannerSettings


@dataclass(frozen=True)
class GraphPlanner:
    """Forecasts of the planning graph, for domains too large to be compiled."""

    model: TransitionModel
    settings: PlannerSettings

    def forecast(self, state: Vector) -> Forecast:
        """Return the forecast for a state `[F]`."""
        graph = PlanningGraph(self.model, self.settings, self.model.check_state(state))
        graph.grow()
        return graph.evaluate()


def lookahead(model: TransitionModel, settings: PlannerSettings) -> Planner:
    """Return the faster lookahead that supports a model; both give the same decisions."""
    return Lookahead(model, settings) if model.compiles else GraphPlanner(model, settings)


def far_sight(model: TransitionModel, settings: PlannerSettings) -> Planner:
    """Return the planner that sees to the end of a finite task, and far in a continuous one."""
    # Its leaves have the values of cells wherever there are any.
    return FarSightPlanner(model, settings, lookahead(model, settings))
