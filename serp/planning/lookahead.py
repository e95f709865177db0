"""The planner on arrays: the decisions of the planning graph, without objects."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED
from serp.model.native import call_step, pointer_to
from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.planning.cells import NO_CELLS, CellValues, value_at
from serp.planning.edges import Bound, FirstActions, edge_budget, lookahead_nodes
from serp.planning.forecast import SAFE, Forecast
from serp.planning.hash_table import state_slot, table_size
from serp.planning.preference import (
    PathScore,
    compiled_path_score,
    compiled_rank_of,
    compiled_within_slack,
    marked,
    path_score,
    step_risk,
)
from serp.settings import PlannerSettings

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

_DEPTH = int(Bound.DEPTH)
_NODES = int(Bound.NODES)
_EXHAUSTED = int(Bound.EXHAUSTED)
_BITS, _RANK = 0x1F, 6
"""Stored flags of an edge: their bits, and above these its rank."""


@cached_njit(nogil=True)
def search(model, rules, leaves, state, scratch, found):
    """Expand the planning graph of one state and find the best path of every first action.

    Where a budget ends the expansion, leaves are worth 0.

    Args:
        model: `TransitionModel.machine_code`.
        rules: Actions, depth, discount, accepted risk, most nodes to expand, most edges.
        leaves: Values of `CellValues`: those of the states that the last layer leads to; 0 without.
        state: `[F]`.
        scratch: Memory for N nodes and E edges: flat states; reward, flags, risk and child (-1 for
            none) `[E]`; value, risk and steps of the best path `[N]`; hash table.
        found: Values of `FirstActions`, written.

    Returns:
        Chosen action, layers expanded, bound, edges followed.
    """
    actions, depth, discount, accepted, max_nodes, max_edges = rules
    states, reward, flags, risk, child, best_value, best_risk, best_steps, table = scratch
    values = CellValues(*leaves)
    address, data, dt = model
    theta = pointer_to(data, 0)
    value, path_risk, steps, first_reward, first_flags = found
    width = state.shape[0]
    row = width + 1
    for i in range(width):
        states[i] = state[i]
    start, end = 0, 1
    expanded = applied = 0
    bound = _DEPTH
    while expanded < depth:
        if start == end:
            bound = _EXHAUSTED
            break
        if end > max_nodes:
            bound = _NODES
            break
        stored = end
        keep = expanded + 1 < depth
        mask = 0
        if keep:
            mask = table_size(min(max_nodes, (end - start) * actions)) - 1
            for i in range(mask + 1):
                table[i] = -1
        for node in range(start, end):
            source = pointer_to(states, node * row)
            for action in range(actions):
                e = node * actions + action
                slot = min(stored, max_nodes)
                target = pointer_to(states, slot * row)
                for i in range(width):
                    target[i] = source[i]
                step = call_step(address, source, action, theta, dt, target)
                reward[e], risk[e] = target[width], step_risk(step, accepted)
                step = marked(step, risk[e])
                flags[e] = step & _BITS | compiled_rank_of(step) << _RANK
                child[e] = -1
                applied += flags[e] & APPLICABLE
                if expanded == 0:
                    first_reward[action] = reward[e]
                    first_flags[action] = step
                if not flags[e] & APPLICABLE or flags[e] & TERMINAL:
                    continue
                if not keep:
                    if values.value.shape[0] > 0:
                        reward[e] += discount * value_at(values, states, slot * row)
                    continue
                if stored > max_nodes:
                    continue  # the next layer is too large to be expanded: all its nodes are leaves
                place = state_slot(table, mask, states, row, pointer_to(states, slot * row), width)
                if table[place] < 0:
                    if stored < max_nodes:
                        table[place] = stored
                    stored += 1
                    if stored > max_nodes:
                        continue
                child[e] = table[place]
            if applied > max_edges and expanded > 0:
                break
        if applied > max_edges and expanded > 0:
            bound = _NODES
            break
        start = end
        end = stored
        expanded += 1
    for node in range(start - 1, -1, -1):
        chosen, chance = -1, False
        top_risk, top_steps, top_value = 0.0, SAFE, 0.0
        best = compiled_path_score(0, top_risk, top_steps, top_value)
        undefined = 0
        for action in range(actions):
            e = node * actions + action
            if not flags[e] & APPLICABLE:
                value[action], path_risk[action], steps[action] = -np.inf, 1.0, -1
                if node == 0:
                    first_reward[action] = 0.0
                undefined |= flags[e] & UNDEFINED
                continue
            total, danger, safe = reward[e], risk[e], SAFE
            if 0 <= child[e] < start:
                total += discount * best_value[child[e]]
                danger += (1.0 - danger) * best_risk[child[e]]
                safe = best_steps[child[e]]
                if safe != SAFE:
                    safe += 1
            if risk[e] > 0.0:
                safe = 0
            # Those of node 0 come last, and remain.
            value[action], path_risk[action], steps[action] = total, danger, safe
            score = compiled_path_score(np.int64(flags[e] >> _RANK), danger, safe, total)
            if chosen < 0 or score > best:
                chosen, best = action, score
                top_risk, top_steps, top_value = danger, safe, total
            chance = chance or 0.0 < danger < 1.0
        if chosen < 0 and undefined:
            # No result can be predicted there, so no action is known to be safe.
            top_risk, top_steps = 1.0, 0
        if chance and accepted > 0.0:
            rank = flags[node * actions + chosen] >> _RANK
            for action in range(actions):
                e = node * actions + action
                if not flags[e] & APPLICABLE or flags[e] >> _RANK != rank:
                    continue
                if not compiled_within_slack(path_risk[action], top_risk, accepted):
                    continue
                path_risk[action], steps[action] = top_risk, top_steps
                if value[action] > top_value or (value[action] == top_value and action < chosen):
                    chosen, top_value = action, value[action]
        best_value[node], best_risk[node], best_steps[node] = top_value, top_risk, top_steps
        if node == 0:
            return chosen, expanded, bound, applied
    return -1, expanded, bound, applied


_CORES = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
_WORTH = 500
"""Most edges of a search from which on threads save time; so many take about 0.1 ms."""


class Lookahead:
    """Monitor-replanning on arrays, for use in every step of a training.

    Memory is bounded by the budgets of nodes and edges and allocated once. Not thread-safe:
    give each thread its own.

    Attributes:
        leaves: The values of the states that the last layer leads to. Without any they are 0, and
            all decisions are those of the planning graph.
        followed: Edges that the newest forecast followed; before the first one, the most.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings | None = None) -> None:
        self.model = model
        self.settings = settings or PlannerSettings()
        self._address = model.machine_code[0]  # compiled now, so that no decision waits for it
        self.leaves = NO_CELLS
        self._width = len(model.fluents)
        self._actions = len(model.actions)
        nodes = lookahead_nodes(self.settings, self._actions, self._width)
        self._rules = (
            self._actions, self.settings.depth, self.settings.discount,
            self.settings.accepted_risk, nodes, edge_budget(self._width),
        )  # fmt: skip
        self.followed = self._most = edges = nodes * self._actions
        self._best = np.zeros(nodes), np.zeros(nodes), np.zeros(nodes, np.int64)
        self._scratch = (
            np.zeros((nodes + 2) * (self._width + 1)), np.zeros(edges), np.zeros(edges, np.uint8),
            np.zeros(edges), np.zeros(edges, np.int32), *self._best,
            np.zeros(table_size(nodes), np.int32),
        )  # fmt: skip
        self._others: list[Lookahead] = []
        self._prefetched: dict[bytes, tuple[CellValues, Forecast, int]] = {}
        """State → the leaves that were used, the forecast, and edges followed for it."""

    def scores(self, count: int) -> Iterator[PathScore]:
        """Yield the score of the best path from each of the first states of the newest forecast.

        They are in the order in which they were found, without those in which the task has ended.
        """
        columns = (column[:count].tolist() for column in self._best)
        for value, risk, steps in zip(*columns, strict=True):
            yield path_score(0, risk, steps, value)

    @contextlib.contextmanager
    def prefetch(self, states: Sequence[Vector]) -> Iterator[None]:
        """Have the forecasts for these states at hand in the body, computed on all cores.

        Model and leaves are used as they are now. Where searches are short, nothing is done, which
        does not depend on the number of cores.
        """
        if len(states) > 1 and self._most >= _WORTH:
            self._prefetch(states, min(_CORES, len(states)))
        try:
            yield
        finally:
            self._prefetched.clear()

    def _prefetch(self, states: Sequence[Vector], threads: int) -> None:
        while len(self._others) < threads:
            self._others.append(Lookahead(self.model, self.settings))

        def forecasts(lookahead: Lookahead, own: Sequence[Vector]) -> None:
            lookahead.leaves = self.leaves
            for state in own:
                found = lookahead.forecast(state)
                self._prefetched[state.tobytes()] = self.leaves, found, lookahead.followed

        with ThreadPoolExecutor(threads) as pool:
            parts = [states[k::threads] for k in range(threads)]
            list(pool.map(forecasts, self._others[:threads], parts))

    def forecast(self, state: NDArray[np.float64]) -> Forecast:
        """Return the forecast for one state `[F]`.

        The values are not checked; see `TransitionModel.check_state`.

        Raises:
            StateError: The shape is wrong.
        """
        state = np.ascontiguousarray(state, dtype=np.float64)
        if state.shape != (self._width,):
            raise StateError(f"a state has {self._width} numbers, found shape {state.shape}")
        if self._prefetched:
            leaves, forecast, followed = self._prefetched.get(state.tobytes(), (None, None, 0))
            if forecast is not None and leaves is self.leaves:
                self.followed = followed
                return forecast
        found = FirstActions.allocate(self._actions)
        choice, depth, bound, self.followed = search(
            (self._address, self.model.data, self.model.dt), self._rules,
            tuple(self.leaves), state, self._scratch, tuple(found),
        )  # fmt: skip
        return Forecast(choice, *found, depth, Bound(bound))
