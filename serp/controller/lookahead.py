"""The lookahead: the best path of every first action, and whether a safe path exists at all."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from .forecast import SAFE, Prospects, rank_of
from .step import APPLICABLE, RISK_SHIFT, RISK_UNIT, RISKY, TERMINAL, UNDEFINED, UNSAFE, State

Step = Callable[[State, int], tuple[State, int]]
LeafValues = Callable[[list[State]], list[float]]
_BITS = 0x1F
_DEEPEST = 200
"""Deepest lookahead that is searched depth first, by recursion."""


class FollowedEdge(NamedTuple):
    """One action, repeated `repeat` times or until it ends.

    Attributes:
        target: The state reached; only where `flags` has APPLICABLE.
        reward, weight: Discounted sum of rewards, and weight of what follows.
        flags: Of all periods together, without the risk.
        rank: Of the first period.
        periods: Periods before the first risk.
        risk: Probability of an unsafe period.
        first_reward, first_flags: Of the first period.
    """

    target: State
    reward: float
    weight: float
    flags: int
    rank: int
    periods: int
    risk: float
    first_reward: float
    first_flags: int


class SafeSearch:
    """The lookahead of a policy.

    Args:
        data: The settings of the planner.
        step: The transition model.
        actions: Number of ground actions.
    """

    def __init__(self, data: Mapping[str, Any], step: Step, actions: int) -> None:
        self._step, self._actions = step, actions
        self._depth, self._repeat = int(data["depth"]), int(data["repeat"])
        self._discount, self._accepted = float(data["discount"]), float(data["accepted_risk"])
        self._max_nodes, self._max_edges = int(data["max_nodes"]), int(data["max_edges"])
        self.periods = sum(self._discount**k for k in range(self._repeat))
        self.unbounded = self._depth <= _DEEPEST and self._fits()
        """Whether the whole tree fits into the budgets, so that no part of it can be left out."""
        self._order = list(range(actions))

    def _fits(self) -> bool:
        nodes, layer = 0, 1
        for _ in range(self._depth):
            nodes += layer
            layer *= self._actions
            if nodes > self._max_nodes:
                return False
        return nodes * self._actions <= self._max_edges

    def edge(self, state: State, action: int) -> FollowedEdge:
        """Follow an edge of the planning graph."""
        out, flags = self._step(state, action)
        reward = out.pop()
        risk = self._hazard(flags)
        flags = self._marked(flags, risk)
        first_reward, first_flags, rank = reward, flags, rank_of(flags)
        weight, periods = self._discount, 0 if risk > 0.0 else 1
        for _ in range(self._repeat - 1):
            if not flags & APPLICABLE or flags & TERMINAL:
                break
            then, again = self._step(out, action)
            if not again & APPLICABLE:
                break
            out = then
            further = self._hazard(again)
            flags = (flags | self._marked(again, further)) & 0xFF
            risk += (1.0 - risk) * further
            if risk == 0.0:
                periods += 1
            reward += weight * out.pop()
            weight *= self._discount
        return FollowedEdge(
            out, reward, weight, flags & _BITS, rank, periods, risk, first_reward, first_flags
        )

    def _hazard(self, flags: int) -> float:
        if flags & UNSAFE:
            return 1.0
        risk = (flags >> RISK_SHIFT) * RISK_UNIT
        return risk if risk > self._accepted else 0.0

    @staticmethod
    def _marked(flags: int, risk: float) -> int:
        return flags | RISKY if risk > 0.0 and not flags & UNSAFE else flags

    # Whether a safe path exists ----------------------------------------------------------------

    def stays_safe(self, first: FollowedEdge) -> bool:
        """Return whether the best path that begins with an edge is safe, where `unbounded`.

        That is so if any path is: depth first, and the actions that were safe last time first.
        """
        if first.risk > 0.0:
            return False
        if first.flags & TERMINAL:
            return True
        return self._safe_from(first.target, self._depth - 1)

    def _safe_from(self, state: State, depth: int) -> bool:
        if depth == 0:
            return True
        possible = undefined = False
        for place, action in enumerate(self._order):
            edge = self.edge(state, action)
            if not edge.flags & APPLICABLE:
                undefined = undefined or bool(edge.flags & UNDEFINED)
                continue
            possible = True
            if edge.risk == 0.0 and (
                edge.flags & TERMINAL or self._safe_from(edge.target, depth - 1)
            ):
                if place:
                    self._order.insert(0, self._order.pop(self._order.index(action)))
                return True
        return not possible and not undefined

    # The best path -----------------------------------------------------------------------------

    def forecast(self, state: State, leaves: LeafValues | None = None) -> Prospects:
        """Return the predictions for every ground action; `leaves` values the last layer."""
        layers: list[list[list[FollowedEdge]]] = []
        children: list[list[list[int]]] = []
        layer, applied, complete = [state], 0, True
        while len(layers) < self._depth and layer:
            if sum(map(len, layers)) + len(layer) > self._max_nodes:
                complete = False
                break
            edges = [[self.edge(each, a) for a in range(self._actions)] for each in layer]
            applied += sum(edge.flags & APPLICABLE for of_node in edges for edge in of_node)
            if applied > self._max_edges and layers:
                complete = False
                break
            if len(layers) + 1 < self._depth:
                layer, known = _distinct(edges)
            else:
                layer, known = [], [[-1] * self._actions for _ in edges]
                if leaves is not None:
                    edges = _with_values(edges, leaves)
            layers.append(edges)
            children.append(known)
        return self._best(layers, children, complete)

    def _best(
        self,
        layers: list[list[list[FollowedEdge]]],
        children: list[list[list[int]]],
        complete: bool,
    ) -> Prospects:
        """Find the best path of every first action, from the last layer to the first."""
        below: list[tuple[float, int, float]] = []
        for depth in range(len(layers) - 1, -1, -1):
            here: list[tuple[float, int, float]] = []
            for edges, targets in zip(layers[depth], children[depth], strict=True):
                chosen, best = -1, (0, 0.0, 0, 0.0)
                top, undefined = (0.0, SAFE, 0.0), False
                of_actions: list[tuple[float, float, int]] = []
                for action, edge in enumerate(edges):
                    if not edge.flags & APPLICABLE:
                        undefined = undefined or bool(edge.flags & UNDEFINED)
                        of_actions.append((-math.inf, 1.0, -1))
                        continue
                    total, danger, safe = edge.reward, edge.risk, SAFE
                    child = targets[action]
                    if 0 <= child < len(below):
                        next_risk, next_steps, next_value = below[child]
                        total += edge.weight * next_value
                        danger += (1.0 - danger) * next_risk
                        safe = next_steps if next_steps == SAFE else next_steps + edge.periods
                    if edge.risk > 0.0:
                        safe = edge.periods
                    of_actions.append((total, danger, safe))
                    score = -edge.rank, -danger, safe, total
                    if chosen < 0 or score > best:
                        chosen, best, top = action, score, (danger, safe, total)
                if chosen < 0 and undefined:
                    top = (1.0, 0, 0.0)
                here.append(top)
                if depth == 0:
                    return Prospects(
                        chosen,
                        [value for value, _, _ in of_actions],
                        [risk for _, risk, _ in of_actions],
                        [steps for _, _, steps in of_actions],
                        [edge.first_reward if edge.flags & APPLICABLE else 0.0 for edge in edges],
                        [edge.first_flags for edge in edges],
                        complete,
                    )
            below = here
        raise AssertionError("the first layer is always expanded")


def _distinct(edges: list[list[FollowedEdge]]) -> tuple[list[State], list[list[int]]]:
    """Return the states that edges lead to, equal ones once, and which of them each edge does."""
    places: dict[tuple[float, ...], int] = {}
    states: list[State] = []
    known: list[list[int]] = []
    for of_node in edges:
        targets = []
        for edge in of_node:
            place = -1
            if edge.flags & APPLICABLE and not edge.flags & TERMINAL:
                place = places.setdefault(tuple(edge.target), len(states))
                if place == len(states):
                    states.append(edge.target)
            targets.append(place)
        known.append(targets)
    return states, known


def _with_values(edges: list[list[FollowedEdge]], leaves: LeafValues) -> list[list[FollowedEdge]]:
    """Return edges whose rewards include the value of the states that they lead to."""
    ends = [
        (k, a)
        for k, of_node in enumerate(edges)
        for a, edge in enumerate(of_node)
        if edge.flags & APPLICABLE and not edge.flags & TERMINAL
    ]
    values = leaves([edges[k][a].target for k, a in ends])
    for (k, a), value in zip(ends, values, strict=True):
        edge = edges[k][a]
        edges[k][a] = edge._replace(reward=edge.reward + edge.weight * value)
    return edges
