"""The search for a way to the goal where not everything that can be reached can be followed."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp.model.flags import APPLICABLE, TERMINAL
from serp.model.native import call_step, pointer_to
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.array_graph import NO_FLUENTS, inert_fluents
from serp.planning.closed_graph import state_node
from serp.planning.hash_table import START, bits_of, finished, mixed, table_size
from serp.planning.preference import step_risk
from serp.planning.relaxation import RelaxedCosts, RelaxedTables, relaxed, relaxed_cost
from serp.settings import PlannerSettings

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

MOST_LEFT = 100
"""States that lack more conditions of the goal than this are taken to lack as many."""
_BY_NOVELTY = 3 * (MOST_LEFT + 1)
_BY_COST = 2_000
"""Queues of both orders; the last one by cost has all states from which the goal costs more."""
_SEEN_BITS = 26
_NODES, _EXPANDED, _TRIED = 0, 1, 2


class SearchArrays(NamedTuple):
    """A search tree of up to N nodes.

    Attributes:
        counters: Nodes, expanded nodes, and edges that were followed.
        table, inert, states: As in `array_graph.GraphArrays`; states are bytes where every value is
            0 or 1.
        parent: `[N]` node that each was reached from; -1 of the root.
        left: `[N]` conditions of the goal that do not hold.
        done: `[N]` whether the node is expanded.
        following: `[2 * N]` next node of the same queue of each order; -1 at its end.
        first, last: Ends of the queues of both orders.
        seen: Set of values and pairs of values, as bits at their hashes.
        atoms: `[F]` scratch memory.
    """

    counters: NDArray[np.int64]
    table: NDArray[np.int32]
    inert: NDArray[np.int64]
    states: NDArray[np.float64 | np.uint8]
    parent: NDArray[np.int32]
    left: NDArray[np.int32]
    done: NDArray[np.uint8]
    following: NDArray[np.int32]
    first: NDArray[np.int32]
    last: NDArray[np.int32]
    seen: NDArray[np.uint64]
    atoms: NDArray[np.uint64]

    @classmethod
    def allocate(
        cls, nodes: int, width: int, inert: NDArray[np.int64], number: type[np.float64 | np.uint8]
    ) -> SearchArrays:
        """Allocate an empty tree; the memory is not touched before it is needed."""
        queues = _BY_NOVELTY + _BY_COST
        parent, left = np.zeros((2, nodes), dtype=np.int32)
        first, last = np.full((2, queues), -1, dtype=np.int32)
        return cls(
            counters=np.zeros(3, dtype=np.int64),
            table=np.full(table_size(nodes), -1, dtype=np.int32),
            inert=inert, states=np.zeros(nodes * width, dtype=number), parent=parent, left=left,
            done=np.zeros(nodes, dtype=np.uint8), following=np.zeros(2 * nodes, dtype=np.int32),
            first=first, last=last, seen=np.zeros(1 << (_SEEN_BITS - 6), dtype=np.uint64),
            atoms=np.zeros(width, dtype=np.uint64),
        )  # fmt: skip


@cached_njit(nogil=True, forceinline=True)
def _atom(group, fluent, value):
    """Return the hash of a fluent's value, among the states that lack as many conditions."""
    return finished(mixed(mixed(group, np.uint64(fluent)), bits_of(value)))


@cached_njit(nogil=True, forceinline=True)
def _is_new(tree, key):
    """Add a value or a pair to the set; return whether it was new."""
    place = key >> np.uint64(64 - _SEEN_BITS)
    bit = np.uint64(1) << (place & np.uint64(63))
    word = np.int64(place >> np.uint64(6))
    new = tree.seen[word] & bit == 0
    tree.seen[word] |= bit
    return new


@cached_njit(nogil=True, forceinline=True)
def _novelty(tree, node, width):
    """Return the novelty of a node, and remember its values and pairs."""
    parent = np.int64(tree.parent[node])
    everything = parent < 0 or tree.left[parent] != tree.left[node]
    group = mixed(np.uint64(START), np.uint64(tree.left[node]))
    count = 0
    for i in range(width):  # the values that changed come first
        value = tree.states[node * width + i]
        if value != 0.0 if everything else value != tree.states[parent * width + i]:
            tree.atoms[count] = _atom(group, i, np.float64(value))
            count += 1
    changed = count
    if not everything:
        for i in range(width):
            value = tree.states[node * width + i]
            if value != 0.0 and value == tree.states[parent * width + i]:
                tree.atoms[count] = _atom(group, i, np.float64(value))
                count += 1
    single, pair = False, False
    for k in range(changed):
        single = _is_new(tree, tree.atoms[k]) or single
    for k in range(changed):
        for j in range(k + 1, count):
            one, other = tree.atoms[k], tree.atoms[j]
            pair = _is_new(tree, finished(mixed(min(one, other), max(one, other)))) or pair
    return 1 if single else 2 if pair else 3


@cached_njit(nogil=True, forceinline=True)
def _append(tree, order, queue, node):
    nodes = tree.done.shape[0]
    tree.following[order * nodes + node] = -1
    if tree.first[queue] < 0:
        tree.first[queue] = node
    else:
        tree.following[order * nodes + tree.last[queue]] = node
    tree.last[queue] = node


@cached_njit(nogil=True, forceinline=True)
def _enqueue(tree, relaxed, node, row, width):
    cost, left = relaxed_cost(relaxed[0], relaxed[1], row)
    tree.left[node] = min(left, MOST_LEFT)
    novelty = _novelty(tree, node, width) - 1
    _append(tree, 0, novelty * (MOST_LEFT + 1) + np.int64(tree.left[node]), node)
    _append(tree, 1, _BY_NOVELTY + np.int64(min(cost, _BY_COST - 1)), node)


@cached_njit(nogil=True, forceinline=True)
def _dequeue(tree, order):
    """Return the best node of an order that is not expanded; -1 where there is none."""
    nodes = tree.done.shape[0]
    begin = order * _BY_NOVELTY
    for queue in range(begin, begin + (_BY_COST if order else _BY_NOVELTY)):
        while tree.first[queue] >= 0:
            node = np.int64(tree.first[queue])
            tree.first[queue] = tree.following[order * nodes + node]
            if not tree.done[node]:
                tree.done[node] = 1
                return node
    return np.int64(-1)


@cached_njit(nogil=True)
def search(model, relaxed, rules, tree_arrays, root, limit):
    """Search for an edge that reaches the goal.

    Args:
        model: `TransitionModel.machine_code`.
        relaxed: Values of `RelaxedTables`, and of `RelaxedCosts`.
        rules: Number of actions A, accepted risk.
        tree_arrays: Values of `SearchArrays`, empty.
        root: `[F]` where to start.
        limit: Most edges to follow.

    Returns:
        The node that the edge leaves; -1 where none was found.
    """
    tree = SearchArrays(*tree_arrays)
    address, data, dt = model
    actions, accepted = rules
    width = root.shape[0]
    now, out = root.copy(), np.empty(width + 1)
    theta, source, target = pointer_to(data, 0), pointer_to(now, 0), pointer_to(out, 0)
    state_node(tree, source, width)
    tree.parent[0] = -1
    _enqueue(tree, relaxed, np.int64(0), source, width)
    while tree.counters[_TRIED] < limit:
        node = _dequeue(tree, tree.counters[_EXPANDED] % 2)
        if node < 0 or tree.counters[_NODES] + actions > tree.done.shape[0]:
            break
        tree.counters[_EXPANDED] += 1
        for i in range(width):
            source[i] = tree.states[node * width + i]
        changed = True
        for action in range(actions):
            if changed:
                for i in range(width):
                    target[i] = source[i]
                target[width] = 0.0
            flags = call_step(address, source, action, theta, dt, target)
            changed = flags != 0
            if not flags & APPLICABLE:
                continue
            tree.counters[_TRIED] += 1
            if step_risk(flags, accepted) > 0.0:
                continue
            if flags & TERMINAL:
                if target[width] > 0.0:
                    return node
                continue
            before = tree.counters[_NODES]
            reached = state_node(tree, target, width)
            if reached < before:
                continue
            tree.parent[reached] = node
            _enqueue(tree, relaxed, reached, target, width)
    return np.int64(-1)


MAX_BYTES: Final = 320_000_000
"""Most bytes in the states of a search."""


class GoalSearch:
    """Finds a way to the goal, see `serp.planning.goal_search`.

    Where the world moves by itself, by processes, nothing is searched for: a long way through an
    uncertain future is worth less than its values say.

    Attributes:
        steps: Edges that the last search followed.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings) -> None:
        self._model = model
        self._accepted = settings.accepted_risk
        self.steps = 0
        self._relaxed: RelaxedTables | None = None
        if model.actions and not model.ground.processes:
            self._relaxed = relaxed(model.ground, model.theta.tolist())
        if self._relaxed is not None:
            self._inert = inert_fluents(model.ground)
            self.way(np.zeros(len(model.fluents)), 1)  # compiled now, not at a decision

    @property
    def goal(self) -> bool:
        """Whether there is a goal to search for."""
        return self._relaxed is not None

    def way(self, state: Vector, limit: int) -> Vector | None:
        """Return the states `[N, F]` on a way from a state `[F]` to the goal, but the last one.

        The likeliest outcome of every step is followed, no step that is not safe, and at most
        `limit` edges. None where there is no goal, or no way was found.
        """
        self.steps = 0
        if self._relaxed is None:
            return None
        model, width = self._model, len(self._model.fluents)
        actions = len(model.actions)
        inert = self._inert if model.as_written else NO_FLUENTS
        numeric = {fluent.index for fluent in model.fluents if fluent.numeric}
        number = np.float64 if numeric.difference(inert.tolist()) else np.uint8
        most = MAX_BYTES // (max(1, width) * np.dtype(number).itemsize)
        nodes = min(limit, most) + actions + 1
        tree = SearchArrays.allocate(nodes, width, inert, number)
        node = search(
            model.machine_code,
            (tuple(self._relaxed), tuple(RelaxedCosts.allocate(self._relaxed))),
            (actions, self._accepted), tuple(tree), state, limit,
        )  # fmt: skip
        self.steps = int(tree.counters[2])
        if node < 0:
            return None
        way = []
        while node >= 0:
            way.append(tree.states[node * width : (node + 1) * width])
            node = int(tree.parent[node])
        return np.array(way[::-1], dtype=np.float64)
