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

from serp._util.compilation import cached_njit
from serp._util.saved_state import Arrays, Saved
from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED
from serp.model.native import OUTCOMES, address_of, call_step, pointer_to
from serp.model.transition_model import TransitionModel, Vector
from serp.planning import value_iteration as solution
from serp.planning.array_graph import (
    DONE,
    ENDED,
    FULL,
    MANY,
    NO_FLUENTS,
    ArrayGraph,
    Counters,
    GraphArrays,
    contents,
    inert_fluents,
    restored,
)
from serp.planning.edges import Bound, FirstActions
from serp.planning.forecast import Forecast
from serp.planning.hash_table import state_slot
from serp.planning.preference import marked, step_risk
from serp.settings import PlannerSettings

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

_NODES, _EXPANDED, _EDGES, _OUTCOMES = Counters()


@cached_njit(nogil=True, forceinline=True)
def add_node(graph, slot, row, width):
    """Add a node with a state at a free slot of the hash table; return it."""
    node = graph.counters[_NODES]
    graph.counters[_NODES] = node + 1
    graph.table[slot] = node
    for i in range(width):
        graph.states[node * width + i] = row[i]
    return node


@cached_njit(nogil=True, forceinline=True)
def state_node(graph, row, width):
    """Return the node with a state, adding it where there is none; inert fluents become 0.

    `graph` is a record with counters, table, inert and states, as `GraphArrays` has them.
    """
    for k in range(graph.inert.shape[0]):
        row[graph.inert[k]] = 0.0
    slot = state_slot(graph.table, graph.table.shape[0] - 1, graph.states, width, row, width)
    if graph.table[slot] >= 0:
        return np.int64(graph.table[slot])
    return add_node(graph, slot, row, width)


@cached_njit(nogil=True)
def find(arrays, state):
    """Return the node with a state `[F]`, in which inert fluents are 0; -1 if there is none."""
    graph = GraphArrays(*arrays)
    width, mask = state.shape[0], graph.table.shape[0] - 1
    return np.int64(graph.table[state_slot(graph.table, mask, graph.states, width, state, width)])


@cached_njit(nogil=True)
def add_root(arrays, state):
    """Add a node with a state `[F]`, if there is none; there must be room."""
    state_node(GraphArrays(*arrays), state, state.shape[0])


@cached_njit(nogil=True)
def hash_states(arrays):
    """Fill an empty table with all nodes."""
    graph = GraphArrays(*arrays)
    width, mask = graph.states.shape[0] // graph.layer.shape[0], graph.table.shape[0] - 1
    for node in range(graph.counters[_NODES]):
        row = pointer_to(graph.states, node * width)
        graph.table[state_slot(graph.table, mask, graph.states, width, row, width)] = node


@cached_njit(nogil=True, forceinline=True)
def _add_outcome(graph, row, width, reward, terminal, chance, layer):
    """Add an outcome, the state `row`, to the newest edge."""
    edge = graph.counters[_EDGES] - 1
    outcome = graph.counters[_OUTCOMES]
    graph.counters[_OUTCOMES] = outcome + 1
    graph.first_outcome[edge + 1] = outcome + 1
    graph.reward[edge] += chance * reward
    graph.chance[outcome] = chance
    graph.target[outcome] = ENDED
    if not terminal:
        before = graph.counters[_NODES]
        node = state_node(graph, row, width)
        graph.target[outcome] = node
        if node == before:
            graph.layer[node] = layer


@cached_njit(nogil=True)
def expand(model, branches, rules, arrays, room, most):
    """Expand nodes until all are expanded, the arrays are full, or there are enough edges.

    Args:
        model: `TransitionModel.machine_code`.
        branches: Address of the compiled function that gives all outcomes of a step, see
            `TransitionModel.native_outcomes`; 0 where the model has one outcome a step.
        rules: Number of actions A, accepted risk.
        arrays: Values of `GraphArrays`.
        room: Flat, `OUTCOMES` rows of F + 3 numbers: states, then reward, flags and probability.
        most: No node is expanded when there are so many edges.

    Returns:
        `DONE`, `FULL` or `MANY`.
    """
    graph = GraphArrays(*arrays)
    actions, accepted = rules
    address, data, dt = model
    theta = pointer_to(data, 0)
    width = graph.states.shape[0] // graph.layer.shape[0]
    while graph.counters[_EXPANDED] < graph.counters[_NODES]:
        if graph.counters[_EDGES] >= most:
            return MANY
        if (
            graph.counters[_NODES] + actions * OUTCOMES > graph.layer.shape[0]
            or graph.counters[_EDGES] + actions > graph.action.shape[0]
            or graph.counters[_OUTCOMES] + actions * OUTCOMES > graph.target.shape[0]
        ):
            return FULL
        node = graph.counters[_EXPANDED]
        layer = graph.layer[node] + 1
        graph.undefined[node] = 0
        source, out = pointer_to(graph.states, node * width), pointer_to(room, 0)
        changed = True
        for action in range(actions):
            if changed:  # an action whose precondition fails changes nothing
                for i in range(width):
                    out[i] = source[i]
                out[width] = 0.0
            flags = call_step(address, source, action, theta, dt, out)
            changed = flags != 0
            if not flags & APPLICABLE:
                if flags & UNDEFINED:
                    graph.undefined[node] = 1
                continue
            edge = graph.counters[_EDGES]
            graph.counters[_EDGES] = edge + 1
            danger = step_risk(flags, accepted)
            graph.action[edge], graph.step_risk[edge], graph.reward[edge] = action, danger, 0.0
            graph.flags[edge] = marked(flags, danger)
            graph.first_outcome[edge + 1] = graph.counters[_OUTCOMES]
            if branches == 0:
                _add_outcome(graph, out, width, out[width], flags & TERMINAL, 1.0, layer)
                continue
            count = call_step(branches, source, action, theta, dt, out)
            for k in range(count):
                row = pointer_to(room, k * (width + 3))
                ended = np.int64(row[width + 1]) & TERMINAL
                _add_outcome(graph, row, width, row[width], ended, row[width + 2], layer)
        graph.counters[_EXPANDED] = node + 1
        graph.first_edge[node + 1] = graph.counters[_EDGES]
    return DONE


MAX_EDGES: Final = 400_000
"""Most edges of a graph; with this many, expansion and solution take about a second."""
MAX_BYTES: Final = 400_000_000
"""Most bytes of the arrays of a graph."""
_JUDGED_FROM, _NEVER_MET = 512, 0.98
"""Expansion ends if, after so many edges, this fraction of them leads to new states."""
_SMALLEST: Final = 256
"""Nodes that the arrays have room for at first."""


class ClosedGraph(ArrayGraph):
    """A planning graph in which all equal states are one node.

    It has at most `max_edges` edges.
    """

    def __init__(
        self, model: TransitionModel, settings: PlannerSettings, max_edges: int = MAX_EDGES
    ) -> None:
        super().__init__(model, settings)
        self._max_edges = max_edges
        self._rules = (settings.discount, settings.accepted_risk)
        self._room = np.empty(OUTCOMES * (self._width + 3))
        self.clear()
        if self._actions:  # every loop is compiled now, so that no decision waits for it
            state = np.zeros(self._width)
            self.grow(state, 1)
            self._look_up(self._find(state))
            self._enlarge()
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
            if self.nodes == len(self._arrays.layer) and not self._enlarge():
                break
            add_root(self._arrays_tuple, state)
        limit = min(limit, self._max_edges)
        ended, most = MANY, _JUDGED_FROM
        while ended != DONE and (self.expanded < least or self.edges < limit):
            while most <= self.edges:
                most *= 2
            ended = self._expand(min(most, limit) if self.edges < limit else self.edges + 1)
            if ended == FULL:
                if not self._enlarge():
                    break
            elif self.edges >= most and self.expanded >= least and self.spreads:
                break
        self._solve()

    def _solve(self) -> None:
        solution.solve(self._arrays_tuple, *self._rules)
        self._measure()

    def _measure(self) -> None:
        """Find what follows from the solved graph: unit of the values, and depth."""
        values = self._arrays.value[: self.nodes]
        self._unit = solution.ALIKE * float(np.abs(values).max(initial=0.0))
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
        return int(find(self._arrays_tuple, state))

    def _look_up(self, node: int) -> tuple[int, FirstActions]:
        """Return the chosen action of a node, and what is predicted for every action."""
        found = FirstActions.allocate(self._actions)
        choice = solution.look_up(self._arrays_tuple, node, self._rules, self._unit, tuple(found))
        return choice, found

    def _expand(self, most: int) -> int:
        """Expand nodes until there are `most` edges; return what ended it."""
        outcomes = self._model.native_outcomes()
        ended = expand(
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

    def _enlarge(self) -> bool:
        """Double the arrays that are nearly full; return whether that keeps within the bytes."""
        old, spare = self._arrays, self._actions * OUTCOMES
        used = self.nodes + spare, self.edges + self._actions, int(old.counters[_OUTCOMES]) + spare
        nodes, edges, outcomes = sizes = [
            2 * len(column) if count >= len(column) else len(column)
            for count, column in zip(used, (old.layer, old.action, old.target), strict=True)
        ]
        if np.dot(sizes, (8 * self._width + 60, 36, 12)) > MAX_BYTES:
            return False
        try:
            self._hold(GraphArrays.allocate(nodes, edges, outcomes, self._width, self._inert))
        except MemoryError:
            return False
        new = self._arrays
        new.counters[:] = old.counters
        for name, column in contents(old, self._width).items():  # touches what is filled only
            getattr(new, name)[: len(column)] = column
        hash_states(self._arrays_tuple)
        return True

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
        hash_states(self._arrays_tuple)
        solution.mark_dead_ends(self._arrays_tuple)
        self._measure()
