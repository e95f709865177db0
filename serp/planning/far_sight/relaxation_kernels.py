"""The additive heuristic: the cost of the goal in the relaxed domain.

It assumes that no operator helps two facts (Bonet & Geffner, "Planning as heuristic search",
Artificial Intelligence 129, 2001).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp.planning.far_sight.relaxation import RelaxedTables

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"


class RelaxedCosts(NamedTuple):
    """Memory for the costs of one state.

    Attributes:
        cost: Of each fact; infinite while it is unreachable.
        passed: The cost of each fact that its operators know.
        gap: Of each comparison: what the sum lacks.
        queue, queued: Facts whose operators are to be updated, a ring, and whether they are in it.
        missing, sums: Of each operator: facts that are unreachable, costs of the others.
    """

    cost: NDArray[np.float64]
    passed: NDArray[np.float64]
    gap: NDArray[np.float64]
    queue: NDArray[np.int64]
    queued: NDArray[np.uint8]
    missing: NDArray[np.int64]
    sums: NDArray[np.float64]

    @classmethod
    def allocate(cls, tables: RelaxedTables) -> RelaxedCosts:
        """Allocate room for the facts and operators of a relaxed domain."""
        facts, operators = len(tables.user_first) - 1, len(tables.needs)
        return cls(
            cost=np.zeros(facts),
            passed=np.zeros(facts),
            gap=np.zeros(len(tables.constant)),
            queue=np.zeros(facts + 1, dtype=np.int64),
            queued=np.zeros(facts, dtype=np.uint8),
            missing=np.zeros(operators, dtype=np.int64),
            sums=np.zeros(operators),
        )


@cached_njit(nogil=True, forceinline=True)
def _push(work, fact, end):
    """Put a fact into the ring; return the new end."""
    if work.queued[fact]:
        return end
    work.queued[fact] = 1
    work.queue[end] = fact
    end += 1
    return end if end < work.queue.shape[0] else np.int64(0)


@cached_njit(nogil=True, forceinline=True)
def _apply(tables, work, operator, end):
    """Lower the costs of what an operator makes true; return the new end of the ring."""
    for k in range(tables.add_first[operator], tables.add_first[operator + 1]):
        fact, gain = tables.add_fact[k], tables.add_gain[k]
        times = 1.0
        if gain > 0.0:
            comparison = fact - work.cost.shape[0] + work.gap.shape[0]
            times = max(1.0, np.ceil(work.gap[comparison] / gain))
        cost = work.sums[operator] + times * tables.cost[operator]
        if cost < work.cost[fact] - 1e-9:
            work.cost[fact] = cost
            end = _push(work, fact, end)
    return end


@cached_njit(nogil=True, forceinline=True)
def _begin(tables, work, state):
    """Set the costs of the facts that hold to 0; return the end of the ring."""
    end, base = np.int64(0), work.cost.shape[0] - work.gap.shape[0]
    for fact in range(work.cost.shape[0]):
        work.cost[fact] = work.passed[fact] = np.inf
        work.queued[fact] = 0
    for i in range(base // 2):
        work.cost[2 * i + (1 if state[i] != 0.0 else 0)] = 0.0
    for k in range(work.gap.shape[0]):
        total = tables.constant[k]
        for t in range(tables.term_first[k], tables.term_first[k + 1]):
            total += tables.term_factor[t] * state[tables.term_fluent[t]]
        work.gap[k] = -total
        if total > 0.0 or (total == 0.0 and not tables.strict[k]):
            work.cost[base + k] = 0.0
    for fact in range(work.cost.shape[0]):
        if work.cost[fact] == 0.0 and tables.user_first[fact] < tables.user_first[fact + 1]:
            end = _push(work, fact, end)
    for operator in range(work.missing.shape[0]):
        work.missing[operator] = tables.needs[operator]
        work.sums[operator] = 0.0
        if work.missing[operator] == 0:
            end = _apply(tables, work, operator, end)
    return end


@cached_njit(nogil=True)
def relaxed_cost(tables_arrays, work_arrays, state):
    """Find how far away the goal is.

    Args:
        tables_arrays: Values of `RelaxedTables`.
        work_arrays: Values of `RelaxedCosts`, scratch memory.
        state: Pointer to the state.

    Returns:
        Its additive cost, infinite if it is unreachable; the least number of facts of a way to it
        that do not hold.
    """
    tables, work = RelaxedTables(*tables_arrays), RelaxedCosts(*work_arrays)
    end, start = _begin(tables, work, state), np.int64(0)
    while start != end:
        fact = work.queue[start]
        start += 1
        if start == work.queue.shape[0]:
            start = np.int64(0)
        work.queued[fact] = 0
        before, cost = work.passed[fact], work.cost[fact]
        work.passed[fact] = cost
        for k in range(tables.user_first[fact], tables.user_first[fact + 1]):
            operator = tables.user[k]
            if before == np.inf:
                work.missing[operator] -= 1
                work.sums[operator] += cost
            else:
                work.sums[operator] += cost - before
            if work.missing[operator] == 0:
                end = _apply(tables, work, operator, end)
    least, left = np.inf, np.int64(work.cost.shape[0])
    for way in range(tables.way_first.shape[0] - 1):
        cost, lacks = 0.0, np.int64(0)
        for k in range(tables.way_first[way], tables.way_first[way + 1]):
            cost += work.cost[tables.way_fact[k]]
            lacks += work.cost[tables.way_fact[k]] > 0.0
        least, left = min(least, cost), min(left, lacks)
    return least, left
