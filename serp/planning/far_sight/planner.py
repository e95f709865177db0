"""The planner that sees far: a closed graph where there is one, else values of cells at leaves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, Protocol

from serp._util.saved_state import Saved
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.far_sight.cell_graph import CellGraph, Visited
from serp.planning.far_sight.closed_graph import ClosedGraph
from serp.planning.forecast import Forecast
from serp.planning.lookahead import Lookahead
from serp.settings import PlannerSettings

_EARNED: Final = 1_000
"""Edges that every decision earns; their expansion and solution take one to three milliseconds."""
_MOST_FAILURES: Final = 10

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

    The graph is built again when the model has changed, and grows when the world is in a state that
    is not in it. Every decision earns the time for a number of edges, which a graph spends when it
    is built: so a large graph of a model that changes often is built rarely, and the mean cost of
    a decision is bounded. Each further graph in a row that could not be closed costs twice as much.

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
        self._owed = self._failures = 0
        self.begin_episode()

    def begin_episode(self) -> None:
        """Forget the graph, so that decisions depend on nothing before this episode."""
        self.graph.clear()
        self._revision = self.model.revision

    def forecast(self, state: Vector) -> Forecast:
        """Return the forecast for a state `[F]`."""
        if self.model.revision != self._revision and self._owed <= 0:
            self._revision = self.model.revision
            self.graph.clear()
        found = self.graph.forecast(state)
        if found is None and self._owed <= 0:
            if not self.graph.complete:
                self.graph.clear()
            before = self.graph.edges
            self.graph.grow(state)
            found = self.graph.forecast(state)
            self._failures = 0 if found is not None else min(self._failures + 1, _MOST_FAILURES)
            self._owed += (self.graph.edges - before) << self._failures
        self._owed = max(0, self._owed - _EARNED)
        return found if found is not None else self._forecast_outside(state)

    def _forecast_outside(self, state: Vector) -> Forecast:
        return self._near.forecast(state)

    def state_dict(self) -> dict[str, Any]:
        """Return JSON values that `load_state_dict` restores exactly, between episodes."""
        return {"owed": self._owed, "failures": self._failures}

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It is damaged.
        """
        saved = Saved("planner", {}, meta)
        self._owed = saved.whole("owed")
        self._failures = saved.whole("failures", 0, _MOST_FAILURES)
        self.begin_episode()


class FarSightPlanner(ClosedGraphPlanner):
    """The same with a `Lookahead`, which takes the values of cells at its leaves.

    Attributes:
        visited: The visited states; None if they are not known. Without them there are no cells.
        cells: The graph of cells.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings, near: Lookahead) -> None:
        self.visited: Visited | None = None
        self.cells = CellGraph(model, settings)
        super().__init__(model, settings, near)
        self._lookahead = near

    def begin_episode(self) -> None:
        """Forget both graphs, so that decisions depend on nothing before this episode."""
        super().begin_episode()
        self.cells.clear()
        self._built = self._since = 0

    def _forecast_outside(self, state: Vector) -> Forecast:
        self._since += 1
        seen = 0 if self.visited is None else self.visited.seen
        waited = self._built == 0 or self._since > _DECISIONS
        if self.visited is not None and waited and seen > _GROWN * self._built:
            self._built, self._since = seen, 0
            self.cells.build(state, self.visited.next_states)
        self._lookahead.leaves = self.cells.values
        return self._lookahead.forecast(state)
