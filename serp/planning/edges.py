"""Bounds on the expansion of a planning graph."""

from __future__ import annotations

from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp.model.flags import APPLICABLE, TERMINAL
from serp.model.native import call_step, pointer_to
from serp.planning.hash_table import table_size
from serp.planning.preference import compiled_joined, compiled_rank_of, hazard, marked
from serp.settings import PlannerSettings


class Rules(NamedTuple):
    """Limits of a search, and its treatment of rewards and risks; see `PlannerSettings`."""

    actions: int
    depth: int
    repeat: int
    discount: float
    accepted_risk: float
    max_nodes: int = 1
    max_edges: int = 1


class Scratch(NamedTuple):
    """Memory of one search: states, edges (`child` is -1 for none), best paths, hash table."""

    states: NDArray[np.float64]
    reward: NDArray[np.float64]
    weight: NDArray[np.float64]
    flags: NDArray[np.uint8]
    periods: NDArray[np.int32]
    risk: NDArray[np.float64]
    child: NDArray[np.int32]
    best_value: NDArray[np.float64]
    best_risk: NDArray[np.float64]
    best_steps: NDArray[np.int64]
    table: NDArray[np.int32]

    @classmethod
    def allocate(cls, nodes: int, actions: int, width: int) -> Scratch:
        """Allocate memory for searches that expand at most `nodes` nodes."""
        edges = nodes * actions
        return cls(
            states=np.zeros((nodes + 2) * (width + 1)),
            reward=np.zeros(edges),
            weight=np.zeros(edges),
            flags=np.zeros(edges, np.uint8),
            periods=np.zeros(edges, np.int32),
            risk=np.zeros(edges),
            child=np.zeros(edges, np.int32),
            best_value=np.zeros(nodes),
            best_risk=np.zeros(nodes),
            best_steps=np.zeros(nodes, np.int64),
            table=np.zeros(table_size(nodes), np.int32),
        )


class FirstActions(NamedTuple):
    """Results of a search for every first action, `[A]`; see `serp.planning.forecast.Forecast`."""

    value: NDArray[np.float64]
    path_risk: NDArray[np.float64]
    safe_steps: NDArray[np.int64]
    reward: NDArray[np.float64]
    flags: NDArray[np.int64]

    @classmethod
    def allocate(cls, count: int) -> FirstActions:
        """Allocate room for `count` actions."""
        return cls(
            np.empty(count), np.empty(count), np.empty(count, np.int64), np.empty(count),
            np.empty(count, np.int64),
        )  # fmt: skip


# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"


@cached_njit(nogil=True, forceinline=True)
def edge(model, rules, state, action, target, scratch, width):
    """Follow one edge: `action`, `repeat` times or until it ends.

    States are pointers to rows of `width` numbers; `target` has one more, for the reward.

    Returns:
        What `Edge` has from `reward` on; reward and flags of the first period.
    """
    address, data, dt = model
    theta, accepted = pointer_to(data, 0), rules.accepted_risk
    for i in range(width):
        target[i] = state[i]
    flags = call_step(address, state, action, theta, dt, target)
    reward = target[width]
    first_reward = reward
    risk = hazard(flags, accepted)
    flags = marked(flags, risk)
    first_flags = flags
    rank = compiled_rank_of(flags)
    weight = rules.discount
    periods = 0 if risk > 0.0 else 1
    for _ in range(rules.repeat - 1):
        if not flags & APPLICABLE or flags & TERMINAL:
            break
        for i in range(width):
            scratch[i] = target[i]
        again = call_step(address, scratch, action, theta, dt, target)
        if not again & APPLICABLE:
            for i in range(width):
                target[i] = scratch[i]
            break
        further = hazard(again, accepted)
        flags = compiled_joined(flags, marked(again, further))
        risk += (1.0 - risk) * further
        if risk == 0.0:
            periods += 1
        reward += weight * target[width]
        weight *= rules.discount
    return reward, weight, flags, rank, periods, risk, first_reward, first_flags


@cached_njit(nogil=True)
def expand(model, rules, nodes, states, out, found):
    """Follow every edge of the `nodes` rows of `states`; rows are flat, of F + 1 numbers.

    `out` receives the states reached, a row an edge and one to work in; `found`, six arrays, what
    `edge` returns first.
    """
    reward, weight, flags, rank, periods, risk = found
    limits = Rules(*rules)
    actions, row = limits.actions, states.shape[0] // nodes
    scratch = pointer_to(out, nodes * actions * row)
    for node in range(nodes):
        state = pointer_to(states, node * row)
        for action in range(actions):
            e = node * actions + action
            reward[e], weight[e], flags[e], rank[e], periods[e], risk[e], _, _ = edge(
                model, limits, state, action, pointer_to(out, e * row), scratch, row - 1
            )


MAX_EDGES: Final = 4_000_000
"""Most edges that are tried."""
MAX_NUMBERS: Final = 10_000_000
"""Most numbers in all states that the edges of a graph lead to."""


class Bound(IntEnum):
    """What ended the expansion of the planning graph.

    `DEPTH`: so many layers were asked for. `NODES`, `TIME`: a budget was spent. `EXHAUSTED`: all
    that can be reached is in the graph. `CELLS`: the last layer, whose states have the values of a
    graph over cells, which holds all that is known and can be reached. `UNKNOWN`: the same, and
    nothing known there is worth more than going on, so the plan leads to what is not known, whose
    value is the most that there could be.
    """

    DEPTH = 0
    NODES = 1
    TIME = 2
    EXHAUSTED = 3
    CELLS = 4
    UNKNOWN = 5

    @property
    def partial(self) -> bool:
        """Whether returns are those of the steps in sight, and leave out what comes later."""
        return self in (Bound.DEPTH, Bound.NODES, Bound.TIME)


def node_budget(max_nodes: int, actions: int) -> int:
    """Return the most nodes to expand, with `actions` edges at each."""
    return max(1, min(max_nodes, MAX_EDGES // max(1, actions)))


def lookahead_nodes(settings: PlannerSettings, actions: int, fluents: int) -> int:
    """Return the most nodes that a lookahead expands: the budget, or the whole tree if smaller.

    Every node but the root has an edge that leads to it.
    """
    budget = min(node_budget(settings.max_nodes, actions), edge_budget(fluents) + 1)
    tree, layer = 0, 1
    for _ in range(settings.depth):
        tree += layer
        layer *= max(1, actions)
        if tree >= budget:
            return budget
    return tree


def edge_budget(fluents: int) -> int:
    """Return the most edges of a graph whose states have `fluents` numbers.

    This bounds the memory: a layer that would exceed it is dropped, as by `max_nodes`.
    """
    return MAX_NUMBERS // (fluents + 1)
