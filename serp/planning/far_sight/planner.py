"""The planner that sees far: a closed graph where there is one, else values of cells at leaves."""

from __future__ import annotations

from typing import Final, Protocol

from serp.model.transition_model import TransitionModel, Vector
from serp.planning.far_sight.cell_graph import CellGraph, Visited
from serp.planning.far_sight.closed_graph import ClosedGraph
from serp.planning.forecast import Forecast
from serp.planning.lookahead import Lookahead
from serp.settings import PlannerSettings

_PATIENCE: Final = 4
"""After a graph could not be closed, so many times more decisions pass before the next attempt."""

_DECISIONS: Final = 20
"""Decisions between two builds of the graph of cells, at least."""
_GROWN: Final = 1.05
"""It is built again when so many times as many states were visited."""


class NearPlanner(Protocol):
    """The planner that is asked outside of the graph."""

    def forecast(self, state: Vector) -> Forecast:
        """Return the forecast for a state `[F]`."""


class ClosedGraphPlanner:
    """Plans on the closed graph where the best policy stays inside it, else by another planner.

    The graph is built again when the model has changed, or when the world is in a state that is
    not in it. After a graph could not be closed, so many decisions pass before the next attempt
    that attempts take little time.

    Args:
        model: The transition model.
        settings: The settings of the planner.
        near: The planner that is asked outside of the graph.

    Attributes:
        model: As above.
        graph: The graph.
    """

    def __init__(
        self, model: TransitionModel, settings: PlannerSettings, near: NearPlanner
    ) -> None:
        self.model = model
        self.graph = ClosedGraph(model, settings)
        self._near = near
        self.begin_episode()

    def begin_episode(self) -> None:
        """Forget the graph, so that decisions depend on nothing before this episode."""
        self.graph.clear()
        self._revision = self.model.revision
        self._waited = self._wait = 0

    def forecast(self, state: Vector) -> Forecast:
        """Return the forecast for a state `[F]`."""
        if self.model.revision != self._revision:
            self._revision = self.model.revision
            self.graph.clear()
        found = self.graph.forecast(state)
        if found is None and self._waited >= self._wait:
            if not self.graph.complete:
                self.graph.clear()
            self.graph.grow(state)
            found = self.graph.forecast(state)
            self._waited, self._wait = 0, 0 if found is not None else _PATIENCE * self._wait + 1
        if found is not None:
            return found
        self._waited += 1
        return self._forecast_outside(state)

    def _forecast_outside(self, state: Vector) -> Forecast:
        return self._near.forecast(state)


class FarSightPlanner(ClosedGraphPlanner):
    """The same with a `Lookahead`, which takes the values of cells at its leaves.

    Attributes:
        visited: The visited states; None if they are not known. Without them there are no cells.
        cells: The graph of cells.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings, near: Lookahead) -> None:
        self.visited: Visited | None = None
        self.cells = CellGraph(model, settings)
        self._far = Lookahead(model, settings.replace(leaf_value="always"))
        super().__init__(model, settings, near)
        self._lookahead = near

    def begin_episode(self) -> None:
        """Forget both graphs, so that decisions depend on nothing before this episode."""
        super().begin_episode()
        self.cells.clear()
        self._built = self._since = 0

    @property
    def leaves(self) -> Vector:
        """The value function at the leaves where there are no cells, see `Lookahead.leaves`."""
        return self._lookahead.leaves

    @leaves.setter
    def leaves(self, packed: Vector) -> None:
        self._lookahead.leaves = packed

    def _forecast_outside(self, state: Vector) -> Forecast:
        self._since += 1
        seen = 0 if self.visited is None else self.visited.seen
        waited = self._built == 0 or self._since > _DECISIONS
        if self.visited is not None and waited and seen > _GROWN * self._built:
            self._built, self._since = seen, 0
            self.cells.build(state, self.visited.next_states)
        if not self.cells.values.size:
            return self._lookahead.forecast(state)
        self._far.leaves = self.cells.values
        return self._far.forecast(state)
