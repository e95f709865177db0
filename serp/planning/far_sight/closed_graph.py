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

from serp._util.saved_state import Arrays
from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED
from serp.model.native import OUTCOMES, address_of
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.far_sight import closed_kernels as kernels
from serp.planning.far_sight import solution_kernels as solution
from serp.planning.far_sight.closed_kernels import ENDED, NO_FLUENTS, Counters, GraphArrays
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
_AT = Counters()


class ClosedGraph:
    """A planning graph in which all equal states are one node.

    Args:
        model: The transition model.
        settings: Discount and accepted risk.
        max_edges: Most edges.
    """

    def __init__(
        self, model: TransitionModel, settings: PlannerSettings, max_edges: int = MAX_EDGES
    ) -> None:
        self._model = model
        self._settings = settings
        self._width = len(model.fluents)
        self._actions = len(model.actions)
        self._max_edges = max_edges
        self._max_nodes = max(1, MAX_NUMBERS // max(1, self._width))
        self._room = np.empty(OUTCOMES * (self._width + 3))
        self.clear()
        if model.compiles and self._actions:
            self._precompile()

    def _precompile(self) -> None:
        """Call every compiled loop once, so that no decision waits for a compilation."""
        state = np.zeros(self._width)
        kernels.add_root(self._arrays_tuple, state)
        self._expand_native(1)
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
    def nodes(self) -> int:
        """Number of states."""
        return int(self._arrays.counters[_AT.nodes])

    @property
    def expanded(self) -> int:
        """Number of states whose actions were followed."""
        return int(self._arrays.counters[_AT.expanded])

    @property
    def edges(self) -> int:
        """Number of edges."""
        return int(self._arrays.counters[_AT.edges])

    @property
    def complete(self) -> bool:
        """Whether everything that can be reached is in the graph."""
        return self.nodes == self.expanded

    @property
    def spreads(self) -> bool:
        """Whether edges hardly ever lead to a known state, so that the graph will not close."""
        return self.edges >= _JUDGED_FROM and self.nodes > _NEVER_MET * self.edges

    def grow(self, states: Vector, limit: int = MAX_EDGES) -> None:
        """Add a state `[F]` or several, and what can be reached from them, and solve the graph.

        Where the graph would become too large, some nodes are left unexpanded, those with the most
        actions on the way to them.

        Args:
            states: The states.
            limit: Most edges of the graph.
        """
        for state in np.array(states, ndmin=2):
            if self.nodes == self._arrays.digest.shape[0]:
                self._enlarge()
            kernels.add_root(self._arrays_tuple, state)
        limit = min(limit, self._max_edges)
        expand = self._expand_native if self._model.compiles else self._expand_interpreted
        ended, most = kernels.MANY, _JUDGED_FROM
        while ended != kernels.DONE and self.edges < limit and self.nodes < self._max_nodes:
            while most <= self.edges:
                most *= 2
            ended = expand(min(most, limit))
            if ended == kernels.FULL:
                self._enlarge()
            elif self.edges >= most and self.spreads:
                break
        self._solve()

    def _solve(self) -> None:
        allowed = np.empty(self._arrays.action.shape[0], dtype=np.uint8)
        solution.solve(
            self._arrays_tuple, self._settings.discount, solution.EXACT, solution.SWEEPS, allowed
        )
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
        discount = self._settings.discount
        choice = solution.look_up(self._arrays_tuple, node, discount, self._unit, tuple(found))
        return choice, found

    # Expansion ---------------------------------------------------------------------------------

    def _expand_native(self, most: int) -> int:
        """Expand nodes until there are `most` edges; return what ended it."""
        model = self._model
        outcomes = model.native_outcomes()
        ended = kernels.expand(
            (address_of(model.native_step()), model.data, model.dt),
            np.intp(0) if outcomes is None else address_of(outcomes),
            (self._actions, self._settings.accepted_risk), self._arrays_tuple, self._room, most,
        )  # fmt: skip
        return int(ended)

    def _expand_interpreted(self, most: int) -> int:
        """Do the same in CPython, for models too large to be compiled."""
        arrays, accepted = self._arrays, self._settings.accepted_risk
        counters, width = arrays.counters, self._width
        while counters[_AT.expanded] < counters[_AT.nodes]:
            node = int(counters[_AT.expanded])
            if counters[_AT.edges] >= most:
                return kernels.MANY
            if not kernels.has_room(self._arrays_tuple, self._actions):
                return kernels.FULL
            state = arrays.states[node * width : (node + 1) * width].tolist()
            layer = int(arrays.layer[node]) + 1
            arrays.undefined[node] = 0
            for action in range(self._actions):
                target, flags = self._model.transition(state, action)
                if not flags & APPLICABLE:
                    arrays.undefined[node] |= bool(flags & UNDEFINED)
                    continue
                reward = target.pop()
                kernels.add_edge(self._arrays_tuple, action, flags, accepted)
                kernels.add_outcome(
                    self._arrays_tuple, np.array(target), reward, flags & TERMINAL, 1.0, layer
                )
            kernels.close_node(self._arrays_tuple)
        return kernels.DONE

    # Memory ------------------------------------------------------------------------------------

    def _allocate(self, nodes: int, edges: int, outcomes: int) -> None:
        most = self._actions * OUTCOMES
        self._arrays = GraphArrays.allocate(
            nodes + most, edges + self._actions, outcomes + most, self._width, self._inert
        )
        self._arrays_tuple = tuple(self._arrays)

    def _enlarge(self) -> None:
        """Double the arrays."""
        old = self._arrays
        sizes = [2 * len(column) for column in (old.digest, old.action, old.target)]
        self._allocate(*sizes)
        new = self._arrays
        new.counters[:] = old.counters
        for name, column in contents(old, self._width).items():  # touches what is filled only
            getattr(new, name)[: len(column)] = column
        kernels.hash_states(self._arrays_tuple)

    def state_dict(self) -> Arrays:
        """Return arrays that `load_state_dict` restores exactly."""
        return contents(self._arrays, self._width)

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `state_dict` returned, or raise a RunError if it is damaged."""
        self.clear()
        most = self._actions * OUTCOMES
        spare = (most + _SMALLEST, self._actions + _SMALLEST, most + _SMALLEST)
        self._arrays = restored(arrays, self._width, self._actions, spare, self._inert)
        self._arrays_tuple = tuple(self._arrays)
        self._measure()
