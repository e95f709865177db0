"""The closed planning graph: all states that can be reached, and the best action in each.

Equal states are one node, so that the graph of a finite task is finite, and a plan sees to its end.
The graph is solved by value iteration and kept: while the world stays inside it, a decision is a
look-up.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import Arrays, Saved
from serp.model.native import OUTCOMES, address_of
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.far_sight import closed_kernels as kernels
from serp.planning.far_sight import solution_kernels as solution
from serp.planning.far_sight.array_graph import (
    DONE,
    ENDED,
    FULL,
    MANY,
    NO_FLUENTS,
    ArrayGraph,
    GraphArrays,
)
from serp.planning.far_sight.inert import inert_fluents
from serp.planning.far_sight.saved_graph import contents, restored
from serp.planning.forecast import Forecast
from serp.planning.kernel_records import FirstActions
from serp.planning.limits import Bound
from serp.settings import PlannerSettings

MAX_EDGES: Final = 400_000
"""Most edges of a graph; with this many, expansion and solution take about a second."""
MAX_NUMBERS: Final = 20_000_000
"""Most numbers in the states of a graph: 160 MB."""
_JUDGED_FROM, _NEVER_MET = 512, 0.98
"""Expansion ends if, after so many edges, this fraction of them leads to new states."""
_SMALLEST: Final = 256
"""Nodes that the arrays have room for at first."""


class ClosedGraph(ArrayGraph):
    """A planning graph in which all equal states are one node.

    Args:
        model: The transition model.
        settings: Discount and accepted risk.
        max_edges: Most edges.
    """

    def __init__(
        self, model: TransitionModel, settings: PlannerSettings, max_edges: int = MAX_EDGES
    ) -> None:
        super().__init__(model, settings)
        self._max_edges = max_edges
        self._max_nodes = max(1, MAX_NUMBERS // max(1, self._width))
        self._rules = (settings.discount, settings.accepted_risk)
        self._room = np.empty(OUTCOMES * (self._width + 3))
        self.clear()
        if self._actions:
            self._precompile()

    def _precompile(self) -> None:
        """Call every compiled loop once, so that no decision waits for a compilation."""
        state = np.zeros(self._width)
        kernels.add_root(self._arrays_tuple, state)
        self._expand(1)
        self._solve()
        self._look_up(0)
        kernels.hash_states(self._arrays_tuple)
        kernels.find(self._arrays_tuple, state)
        self.clear()

    def clear(self) -> None:
        """Forget all nodes."""
        written = self._model.as_written
        self._inert = inert_fluents(self._model.ground) if written else NO_FLUENTS
        self._allocate(_SMALLEST, _SMALLEST, _SMALLEST)
        self._unit, self._depth = 0.0, 0

    @property
    def complete(self) -> bool:
        """Whether everything that can be reached is in the graph."""
        return self.nodes == self.expanded

    @property
    def spreads(self) -> bool:
        """Whether edges hardly ever lead to a known state, so that the graph will not close.

        Where many actions are applicable, ways meet only after as many nodes.
        """
        enough = self.edges >= _JUDGED_FROM and self.expanded**2 >= self.edges
        return enough and self.nodes > _NEVER_MET * self.edges

    def grow(self, states: Vector, limit: int = MAX_EDGES) -> None:
        """Add a state `[F]` or several, and what can be reached from them, and solve the graph.

        Where the graph would become too large, some nodes are left unexpanded, those with the most
        actions on the way to them.

        Args:
            states: The states. In an empty graph, all of these are expanded.
            limit: Most edges of the graph.
        """
        roots = np.array(states, ndmin=2)
        least = 0 if self.nodes else len(roots)
        for state in roots:
            if self.nodes == len(self._arrays.layer):
                self._enlarge()
            kernels.add_root(self._arrays_tuple, state)
        limit = min(limit, self._max_edges)
        ended, most = MANY, _JUDGED_FROM
        while ended != DONE and (
            self.expanded < least or (self.edges < limit and self.nodes < self._max_nodes)
        ):
            while most <= self.edges:
                most *= 2
            ended = self._expand(min(most, limit) if self.edges < limit else self.edges + 1)
            if ended == FULL:
                self._enlarge()
            elif self.edges >= most and self.expanded >= least and self.spreads:
                break
        self._solve()

    def _solve(self) -> None:
        solution.solve(self._arrays_tuple, *self._rules)
        self._measure()

    def _measure(self) -> None:
        """Find what follows from the solved graph: unit of the values, and depth."""
        self._unit = solution.ALIKE * solution.largest_value(self._arrays_tuple)
        self._depth = int(self._arrays.layer[: self.nodes].max(initial=0))

    def forecast(self, state: Vector) -> Forecast | None:
        """Return the forecast for a state `[F]`.

        Returns:
            None where the state is not in the graph, or its best policy leaves the graph.
        """
        arrays = self._arrays
        node = self._find(state)
        if node < 0 or not arrays.inside[node]:
            return None
        choice, found = self._look_up(node)
        if arrays.undefined[node]:
            flags, values = found.flags, state.tolist()
            for action in np.flatnonzero(flags == 0).tolist():
                flags[action] = self._model.transition(values, action)[1]
        bound = Bound.EXHAUSTED if self.complete else Bound.NODES
        return Forecast(choice, *found, self._depth, bound)

    @property
    def largest(self) -> float:
        """Largest magnitude of a number in all its states."""
        states = self._arrays.states[: self.nodes * self._width]
        return float(np.abs(states).max(initial=0.0))

    def table(self) -> Arrays:
        """Return the forecast for each of the N states that have one, as arrays.

        They are `states` `[N, F]`, `inert` (the columns that are 0 in them), `choice` `[N]`, and
        what a `Forecast` has for every action, `[N, A]`.
        """
        nodes = np.flatnonzero(self._arrays.inside[: self.expanded])
        states = self._arrays.states[: self.nodes * self._width].reshape(-1, self._width)[nodes]
        found = [forecast for state in states if (forecast := self.forecast(state)) is not None]
        columns = {
            name: np.array([getattr(forecast, name) for forecast in found])
            for name in ("choice", *FirstActions._fields)
        }
        return {"states": states.copy(), "inert": self._inert.copy(), **columns}

    def ends(self, state: Vector) -> bool:
        """Return whether the best policy leads from a state `[F]` to the end of the task.

        The first outcome of every step is followed.
        """
        arrays, node, met = self._arrays, self._find(state), set[int]()
        while node >= 0 and node not in met and arrays.inside[node] and arrays.best[node] >= 0:
            met.add(node)
            node = int(arrays.target[arrays.first_outcome[arrays.best[node]]])
        return node == ENDED and bool(met)

    def _find(self, state: Vector) -> int:
        if self._inert.size:
            state = state.copy()
            state[self._inert] = 0.0
        return int(kernels.find(self._arrays_tuple, state))

    def _look_up(self, node: int) -> tuple[int, FirstActions]:
        """Return the chosen action of a node, and what is predicted for every action."""
        found = FirstActions.allocate(self._actions)
        choice = solution.look_up(self._arrays_tuple, node, self._rules, self._unit, tuple(found))
        return choice, found

    def _expand(self, most: int) -> int:
        """Expand nodes until there are `most` edges; return what ended it."""
        outcomes = self._model.native_outcomes()
        ended = kernels.expand(
            self._model.machine_code,
            np.intp(0) if outcomes is None else address_of(outcomes),
            (self._actions, self._settings.accepted_risk), self._arrays_tuple, self._room, most,
        )  # fmt: skip
        return int(ended)

    # Memory ------------------------------------------------------------------------------------

    def _allocate(self, nodes: int, edges: int, outcomes: int) -> None:
        most = self._actions * OUTCOMES
        room = (nodes + most, edges + self._actions, outcomes + most)
        self._hold(GraphArrays.allocate(*room, self._width, self._inert))

    def _enlarge(self) -> None:
        """Double the arrays."""
        old = self._arrays
        sizes = [2 * len(column) for column in (old.layer, old.action, old.target)]
        self._allocate(*sizes)
        new = self._arrays
        new.counters[:] = old.counters
        for name, column in contents(old, self._width).items():  # touches what is filled only
            getattr(new, name)[: len(column)] = column
        kernels.hash_states(self._arrays_tuple)

    def state_dict(self) -> Arrays:
        """Return arrays that `load_state_dict` restores exactly."""
        return contents(self._arrays, self._width) | {"inert": self._inert.copy()}

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `state_dict` returned, or raise a RunError if it is damaged."""
        self.clear()
        saved = Saved("planning graph", arrays, {})
        self._inert = saved.array("inert", np.int64, (-1,), 0, self._width - 1)
        most = self._actions * OUTCOMES
        spare = (most + _SMALLEST, self._actions + _SMALLEST, most + _SMALLEST)
        self._hold(restored(arrays, self._width, self._actions, spare, self._inert))
        solution.mark_doomed(self._arrays_tuple)
        self._measure()
