"""The planner of finite tasks: the closed planning graph, and a lookahead outside of it."""

from __future__ import annotations

from typing import Final, Protocol

from serp.model.transition_model import TransitionModel, Vector
from serp.planning.closed_graph import ClosedGraph
from serp.planning.forecast import Forecast
from serp.settings import PlannerSettings

_PATIENCE: Final = 4
"""After a graph could not be closed, so many times more decisions pass before the next attempt."""


class _Forecasting(Protocol):
    def forecast(self, state: Vector) -> Forecast: ...


class ClosedGraphPlanner:
    """Plans on the closed graph where the best policy stays inside it, else by a lookahead.

    The graph is built again when the model has changed. It is forgotten between episodes, so that
    decisions depend on nothing but the episode.

    Args:
        model: The transition model.
        settings: The settings of the planner.
        near: The planner that is asked outside of the graph.

    Attributes:
        graph: The graph.
        near: As above.
    """

    def __init__(
        self, model: TransitionModel, settings: PlannerSettings, near: _Forecasting
    ) -> None:
        self._model = model
        self.near = near
        self.graph = ClosedGraph(model, settings)
        self._revision = model.revision
        self._waited, self._wait = 0, 0

    def forecast(self, state: Vector) -> Forecast:
        """Return the forecast for a state `[F]`."""
        if self._model.revision != self._revision:
            self._revision = self._model.revision
            self.graph.clear()
        found = self.graph.forecast(state)
        if found is None and self._waited >= self._wait:
            self._waited = 0
            if not self.graph.complete:
                self.graph.clear()
            self.graph.grow(state)
            found = self.graph.forecast(state)
            self._wait = 0 if found is not None else max(1, _PATIENCE * self._wait)
        if found is not None:
            return found
        self._waited += 1
        return self.near.forecast(state)
