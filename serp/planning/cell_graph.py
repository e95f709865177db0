"""A planning graph over cells of the state space, for tasks with continuous states.

States that fall into one cell are one node, so that the graph closes. It says where a task can be
led that is farther than a lookahead sees; a lookahead with these values at its leaves chooses the
action.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED
from serp.model.native import OUTCOMES, address_of, call_step, pointer_to
from serp.model.transition_model import UNKNOWN, TransitionModel, Vector
from serp.planning.array_graph import (
    DONE,
    ENDED,
    FULL,
    ArrayGraph,
    Counters,
    GraphArrays,
    inert_fluents,
)
from serp.planning.cells import (
    AREAS,
    NO_CELLS,
    Cells,
    CellValues,
    digest_of,
    in_range,
    nearness,
    set_value,
    value_at,
)
from serp.planning.closed_graph import add_node
from serp.planning.hash_table import key_slot
from serp.planning.preference import compiled_joined, compiled_rank_of, marked, step_risk
from serp.planning.value_iteration import best_rank
from serp.settings import PlannerSettings

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"


HOLD = 16
"""Most control periods for which an edge holds its action; it ends where it leads a cell's width
away."""
SMALL = 0.01
"""Weights in an interpolation that are a smaller fraction of the others are left out."""
_NODES, _EXPANDED, _EDGES, _OUTCOMES = Counters()


class CellArrays(NamedTuple):
    """What a graph over cells has beside `GraphArrays`; its edges hold their actions.

    Attributes:
        cell: `[N]` digests of the cells of nodes.
        reward: `[E]` discounted sums of rewards.
        periods: `[E]` discounted numbers of control periods.
        weight: `[E]` discount, but that of one period, of what follows.
        beyond: `[E]` discount of what follows an edge that leads to what is not known; else 0.
        target: Flat `[E * F]`, states that edges lead to.
        node: `[E]` the nodes of their cells, or `ENDED`.
    """

    cell: NDArray[np.uint64]
    reward: NDArray[np.float64]
    periods: NDArray[np.float64]
    weight: NDArray[np.float64]
    beyond: NDArray[np.float64]
    target: NDArray[np.float64]
    node: NDArray[np.int64]

    @classmethod
    def allocate(cls, nodes: int, edges: int, width: int) -> CellArrays:
        """Allocate room for so many nodes and edges."""
        reward, periods, weight, beyond = np.zeros((4, edges))
        target, node = np.zeros(edges * width), np.zeros(edges, dtype=np.int64)
        cell = np.zeros(nodes, dtype=np.uint64)
        return cls(cell, reward, periods, weight, beyond, target, node)


@cached_njit(nogil=True)
def add_roots(arrays, division, found, states):
    """Add the cells of states, flat `[N * F]`, as far as there is room."""
    graph, cells, known = GraphArrays(*arrays), Cells(*division), CellArrays(*found).cell
    width = cells.low.shape[0]
    for k in range(states.shape[0] // width):
        row = pointer_to(states, k * width)
        digest = digest_of(row, cells.low, cells.scale, True, -1, 0)
        slot = key_slot(graph.table, known, digest)
        if graph.table[slot] < 0 and graph.counters[_NODES] < graph.layer.shape[0]:
            known[add_node(graph, slot, row, width)] = digest


@cached_njit(nogil=True)
def expand_cells(model, rules, arrays, division, found, room):
    """Expand nodes until all are expanded, the arrays are full, or enough steps were predicted.

    Args:
        model: `TransitionModel.machine_code`, and the address of its uncertainty; 0: everything is
            known.
        rules: Number of actions, discount, accepted risk, most steps to predict.
        arrays: Values of `GraphArrays`.
        division: Values of `Cells`.
        found: Values of `CellArrays`, written.
        room: `[2 (F + 1)]`, scratch memory.

    Returns:
        `DONE` or `FULL`, and the steps that were predicted.
    """
    graph, cells, held_edges = GraphArrays(*arrays), Cells(*division), CellArrays(*found)
    steps = 0
    seen, beyond, periods = held_edges.reward, held_edges.beyond, held_edges.periods
    (address, data, dt), doubts = model
    actions, discount, accepted, most = rules
    theta = pointer_to(data, 0)
    width = cells.low.shape[0]
    count = graph.counters
    now, out = pointer_to(room, 0), pointer_to(room, width + 1)
    while count[_EXPANDED] < count[_NODES]:
        node = count[_EXPANDED]
        if (
            count[_NODES] + actions > graph.layer.shape[0]
            or count[_EDGES] + actions > graph.action.shape[0]
            or steps >= most
        ):
            return FULL, steps
        graph.undefined[node] = 0
        source = pointer_to(graph.states, node * width)
        for action in range(actions):
            for i in range(width):
                now[i] = source[i]
            total, weight, length, danger, held = 0.0, 1.0, 0.0, 0.0, 0
            flags, ended, known = np.int64(0), False, True
            if doubts != 0:
                call_step(doubts, source, action, theta, dt, out)
                known = out[width] < UNKNOWN
            while held < HOLD:
                for i in range(width):
                    out[i] = now[i]
                out[width] = 0.0
                step = np.int64(call_step(address, now, action, theta, dt, out))
                steps += 1
                if not step & APPLICABLE:
                    if held == 0 and step & UNDEFINED:
                        graph.undefined[node] = 1
                    break
                further = step_risk(step, accepted)
                step = marked(step, further)
                flags = step if held == 0 else np.int64(compiled_joined(flags, step))
                danger += (1.0 - danger) * further
                total += weight * out[width]
                length += weight
                weight *= discount
                held += 1
                for i in range(width):
                    now[i] = out[i]
                if step & TERMINAL:
                    ended = True
                    break
                far = not known
                for i in range(width):
                    moved = abs(now[i] - source[i])
                    if moved * cells.scale[i] >= 1.0 or (moved > 0.0 and cells.scale[i] == 0.0):
                        far = True
                        break
                if far:
                    break
            if held == 0:
                continue
            edge = count[_EDGES]
            count[_EDGES] = edge + 1
            graph.action[edge], graph.flags[edge], graph.step_risk[edge] = action, flags, danger
            seen[edge], periods[edge], beyond[edge] = total, length, 0.0
            held_edges.weight[edge] = weight / discount
            held_edges.node[edge] = ENDED
            for i in range(width):
                held_edges.target[edge * width + i] = now[i]
            if ended:
                continue
            if not (known and in_range(cells, now, width)):
                beyond[edge] = weight
                continue
            digest = digest_of(now, cells.low, cells.scale, True, -1, 0)
            slot = key_slot(graph.table, held_edges.cell, digest)
            if graph.table[slot] >= 0:
                held_edges.node[edge] = graph.table[slot]
            else:
                held_edges.node[edge] = add_node(graph, slot, now, width)
                held_edges.cell[held_edges.node[edge]] = digest
        count[_EXPANDED] = node + 1
        graph.first_edge[node + 1] = count[_EDGES]
    return DONE, steps


@cached_njit(nogil=True)
def interpolate(arrays, division, found):
    """Let every edge lead to the cells around the state that it reaches, weighted by nearness.

    A plan would otherwise gain up to a cell's width with every edge. Weights that are positive and
    sum to 1 keep value iteration a contraction (Gordon, ICML 1995). Small ones are left out.
    """
    graph, cells, edges = GraphArrays(*arrays), Cells(*division), CellArrays(*found)
    width = cells.low.shape[0]
    outcome = 0
    graph.first_outcome[0] = 0
    for edge in range(graph.counters[_EDGES]):
        first = outcome
        if edges.node[edge] >= 0:
            at = edge * width
            row = edges.target[at : at + width]
            graph.target[first] = edges.node[edge]
            total = nearness(row, 0, graph.states, edges.node[edge] * width, cells.scale)
            graph.chance[first] = total
            outcome += 1
            for k in range(2 * width):
                if cells.scale[k // 2] <= 0.0 or outcome - first == OUTCOMES:
                    continue
                by = 1 - 2 * (k % 2)
                digest = digest_of(row, cells.low, cells.scale, True, k // 2, by)
                node = graph.table[key_slot(graph.table, edges.cell, digest)]
                if node >= 0:
                    near = nearness(row, 0, graph.states, node * width, cells.scale)
                    if near > SMALL * total:
                        graph.target[outcome], graph.chance[outcome] = node, near
                        outcome += 1
                        total += near
            for k in range(first, outcome):
                graph.chance[k] *= edges.weight[edge] / total
        graph.first_outcome[edge + 1] = outcome
    graph.counters[_OUTCOMES] = outcome


_SWEEPS, _EVALUATIONS = 30, 4
"""Most sweeps over all edges, and sweeps over the best edges after each of them. Further ones
continue from these values at the next build."""


@cached_njit(nogil=True)
def _sweep(sources, edges, outcomes, values, backwards, evaluates):
    """Find the values of all cells once, in one of two orders.

    Args:
        sources: `[n]` cells; `[n + 1]` where the edges of each begin.
        edges: Rewards and discounts of the edges, and where the outcomes of each begin.
        outcomes: Cells that they lead to and weights.
        values: `[N]` values of the cells; `[n]` their best edges, written.
        backwards: Whether the last cell comes first.
        evaluates: Whether only the best edges are followed.

    Returns:
        The largest change, and the largest absolute value.
    """
    node_of, first_edge = sources
    reward, first_outcome = edges
    target, chance = outcomes
    value, best = values
    count = node_of.shape[0]
    change = largest = 0.0
    for k in range(count):
        at = count - 1 - k if backwards else k
        node = node_of[at]
        most, chosen = -np.inf, np.int64(-1)
        start = best[at] if evaluates else first_edge[at]
        for edge in range(start, start + 1 if evaluates else first_edge[at + 1]):
            total = reward[edge]
            for o in range(first_outcome[edge], first_outcome[edge + 1]):
                total += chance[o] * value[target[o]]
            if total > most:
                most, chosen = total, np.int64(edge)
        change = max(change, abs(most - value[node]))
        largest = max(largest, abs(most))
        value[node], best[at] = most, chosen
    return change, largest


@cached_njit(nogil=True)
def begin_values(arrays, width, former, otherwise):
    """Begin with former values, of `CellValues`; with `otherwise` if there are none."""
    graph, values = GraphArrays(*arrays), CellValues(*former)
    for node in range(graph.counters[_NODES]):
        graph.value[node] = otherwise
        if values.value.shape[0] > 0:
            graph.value[node] = value_at(values, graph.states, node * width)


@cached_njit(nogil=True)
def solve_cells(arrays, found, discount, worst, beyond):
    """Find the values of the cells.

    At every cell actions of the best rank are chosen among (see `serp.planning.preference`). The
    probabilities of what an edge leads to come from the division into cells as much as from the
    world. So risk is not minimised before all else, as in an exact graph, where it could only be
    avoided by never coming near anything; what is unsafe is worth the least that can be.

    Args:
        arrays: Values of `GraphArrays`, interpolated; `value` is continued from.
        found: Values of `CellArrays`.
        discount: Weight of a reward one control period later.
        worst: Least value.
        beyond: Value of what is not known.
    """
    graph, held = GraphArrays(*arrays), CellArrays(*found)
    expanded, all_edges = graph.counters[_EXPANDED], graph.counters[_EDGES]
    # Plain arrays of what is left to choose among: the loops run over them a hundred times.
    node_of, first_edge = np.empty(expanded, np.int64), np.zeros(expanded + 1, np.int64)
    reward, first_outcome = np.empty(all_edges), np.zeros(all_edges + 1, np.int64)
    target = np.empty(graph.counters[_OUTCOMES], np.int64)
    chance = np.empty(graph.counters[_OUTCOMES])
    count = edge_count = outcome_count = 0
    for node in range(expanded):
        start, end = graph.first_edge[node], graph.first_edge[node + 1]
        if start == end:
            graph.value[node] = worst if graph.undefined[node] else 0.0
            continue
        lowest = best_rank(graph, node)
        for edge in range(start, end):
            if np.int64(compiled_rank_of(graph.flags[edge])) > lowest:
                continue
            danger, weight = graph.step_risk[edge], discount * held.weight[edge]
            reward[edge_count] = held.reward[edge] + (
                (1.0 - danger) * beyond * held.beyond[edge] + danger * worst * weight
            )
            for k in range(graph.first_outcome[edge], graph.first_outcome[edge + 1]):
                target[outcome_count] = graph.target[k]
                chance[outcome_count] = (1.0 - danger) * discount * graph.chance[k]
                outcome_count += 1
            edge_count += 1
            first_outcome[edge_count] = outcome_count
        node_of[count] = node
        count += 1
        first_edge[count] = edge_count
    sources, edges = (node_of[:count], first_edge), (reward, first_outcome)
    outcomes = (target, chance)
    values = (graph.value, np.empty(count, np.int64))
    for sweep in range(_SWEEPS):
        change, largest = _sweep(sources, edges, outcomes, values, sweep % 2 == 0, False)
        if change <= 1e-4 * largest:
            break
        for again in range(_EVALUATIONS):
            _sweep(sources, edges, outcomes, values, again % 2 == 0, True)


_HOPE: Final = 10.0
"""Where waiting is free, the unknown is worth so many times what it costs to act for ever; a
step of delay costs so many times what a step costs."""
MAX_EDGES: Final = 60_000
"""Most edges of a graph of cells."""
_SAMPLE: Final = 500
"""Visited states that the graph begins with."""
_LEAST: Final = 32
"""Fewer visited states say too little about the ranges of fluents."""
FINEST: Final = 100.0
COARSEST: Final = 4.0
_FINER: Final = 1.4
"""Bins in the range of a fluent: most, least, and the ratio from one attempt to the next."""


class CellGraph(ArrayGraph):
    """A planning graph over cells.

    Args:
        model: The transition model.
        settings: Discount and accepted risk.
        max_edges: Most edges.

    Attributes:
        values: The values of the cells, for `Lookahead.leaves`.
        explores: Whether the plan leads to what is not known.
        bins: Number of bins in the range of a fluent at the next attempt; 0 before the first.
        steps: Steps of the model that the newest build predicted.
        needed: Those of its last attempt.
    """

    def __init__(
        self, model: TransitionModel, settings: PlannerSettings, max_edges: int = MAX_EDGES
    ) -> None:
        super().__init__(model, settings)
        self._edges = max(self._actions, max_edges)
        self._room = np.empty(2 * (self._width + 1))
        self._allocate(self._actions)
        self.values, self.explores = NO_CELLS, False
        self.bins = 0.0
        self.steps = self.needed = 0
        if self._width and self._actions:  # compiled now, so that no decision waits for it
            zeros = np.zeros(self._width)
            cells = Cells(zeros, zeros, zeros)
            self._expand(zeros, cells, 1)
            self._solve(cells)
            set_value(self.values, zeros, 0.0)
            self.values, self.explores, self.steps = NO_CELLS, False, 0

    def build(self, state: Vector, states: Vector, limit: int) -> bool:
        """Build the graph for a state `[F]` and visited states `[N, F]`.

        The division is as fine as `limit`, the steps of the model to predict, allows. It is
        approached from build to build, so that most builds expand the graph once.

        Returns:
            Whether there is one: some fluent is continuous, and cells fit into the limit. If not,
            the former values are kept.
        """
        self.steps = 0
        if len(states) < _LEAST:
            return False
        chosen = np.linspace(0, len(states) - 1, min(len(states), _SAMPLE)).astype(np.intp)
        sample = np.ascontiguousarray(states[chosen])
        low, high = states.min(axis=0), states.max(axis=0)
        divided = (states != np.round(states)).any(axis=0) & (high > low)
        if not divided.any() or not np.isfinite(sample).all():
            return False
        unit = np.where(divided, 1.0 / np.where(divided, high - low, 1.0), 0.0)
        area = unit * AREAS
        if self._model.as_written:
            inert = inert_fluents(self._model.ground)
            unit[inert], area[inert] = -1.0, 0.0
        if len(self._arrays.action) < self._edges:
            self._allocate(self._edges)
        roots = np.concatenate((state, sample.ravel()))

        def divided_into(bins: float) -> Cells:
            return Cells(low, unit * bins, area)

        bins, first = self.bins or COARSEST, not self.bins
        while (used := self._expand(roots, divided_into(bins), limit)) < 0:
            if bins <= COARSEST:
                self.bins = 0.0
                return False
            bins, first = max(COARSEST, bins / _FINER), False
        room = min(limit, self._edges) / (2.0 * _FINER**2)
        while first and used < room and bins * _FINER <= FINEST:
            used = self._expand(roots, divided_into(bins * _FINER), limit)
            if used < 0:
                used = self._expand(roots, divided_into(bins), limit)
                break
            bins *= _FINER
        self._solve(divided_into(bins))
        self.needed = used
        self.bins = bins * _FINER if used < room and bins * _FINER <= FINEST else bins
        return True

    def _expand(self, roots: Vector, cells: Cells, limit: int) -> int:
        """Expand the graph; return the steps that were predicted, -1 if these were too many."""
        arrays, division, doubts = self._arrays, tuple(cells), self._model.native_uncertainty()
        arrays.counters[:] = 0
        arrays.table[:] = -1
        add_roots(self._arrays_tuple, division, self._held, roots)
        ended, steps = expand_cells(
            (self._model.machine_code, np.intp(0) if doubts is None else address_of(doubts)),
            (self._actions, self._settings.discount, self._settings.accepted_risk, limit),
            self._arrays_tuple, division, self._held, self._room,
        )  # fmt: skip
        self.steps += steps
        return int(steps) if ended == DONE else -1

    def _solve(self, cells: Cells) -> None:
        """Solve the graph for what is known, and if that has nothing to offer, for the frontier."""
        interpolate(self._arrays_tuple, tuple(cells), self._held)
        arrays, held, discount = self._arrays, self._edges_held, self._settings.discount
        edges, nodes = self.edges, self.nodes
        if not edges:
            return
        rates = held.reward[:edges] / held.periods[:edges]
        # The reward of an end, or of what is unsafe, is not one that goes on.
        goes_on = (held.node[:edges] != ENDED) | (held.beyond[:edges] > 0.0)
        goes_on &= arrays.step_risk[:edges] == 0.0
        least, middle, most, alike = 0.0, 0.0, 0.0, True
        if goes_on.any():
            least, middle, most = np.quantile(rates[goes_on], (0.0, 0.5, 1.0)).tolist()
            alike = _depend_on_actions_alone(rates[goes_on], arrays.action[:edges][goes_on])
        ages = 1.0 / max(1.0 - discount, 1e-6)
        going_on = most * ages
        worst, hoped = min(0.0, least * ages), max(0.0, going_on)
        if most == 0.0:  # to wait costs nothing
            hoped = -_HOPE * worst if worst < 0.0 else 1.0
        former = NO_CELLS if self.explores else self.values
        begin_values(self._arrays_tuple, self._width, tuple(former), middle * ages)
        solve_cells(self._arrays_tuple, self._held, discount, worst, worst)
        margin = 1e-3 * (hoped - worst)
        self.explores = bool(alike and hoped > going_on and arrays.value[0] <= going_on + margin)
        if self.explores:
            solve_cells(self._arrays_tuple, self._held, discount, worst, hoped)
        elsewhere = hoped if self.explores else worst
        self.values = CellValues.of(
            cells.low, cells.scale, cells.area,
            arrays.states[: nodes * self._width].copy(), np.append(arrays.value[:nodes], elsewhere),
        )  # fmt: skip

    def _allocate(self, edges: int) -> None:
        nodes = edges // max(1, self._actions) + self._actions
        edges += self._actions
        self._hold(GraphArrays.allocate(nodes, edges, edges * OUTCOMES, self._width))
        self._edges_held = CellArrays.allocate(nodes, edges, self._width)
        self._held = tuple(self._edges_held)


def _depend_on_actions_alone(rates: Vector, action: NDArray[np.int64]) -> bool:
    """Return whether no state gives more than others do after the same action."""
    for one in np.unique(action):
        middle, most = np.quantile(rates[action == one], (0.5, 1.0))
        if most - middle > 1e-6 * max(abs(most), abs(middle)):
            return False
    return True
