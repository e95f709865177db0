"""The lookahead: the best path of every first action, and whether a safe path exists at all."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from .forecast import SAFE, Prospects, rank_of
from .reading import Entry
from .step import APPLICABLE, RISK_SHIFT, RISK_UNIT, RISKY, TERMINAL, UNDEFINED, UNSAFE, State

Step = Callable[[State, int], tuple[State, int]]
LeafValues = Callable[[list[State]], list[float]]


class FollowedEdge(NamedTuple):
    """One control period of an action.

    Attributes:
        target: The state reached; only where `flags` has APPLICABLE.
        reward: Its reward.
        flags: Its flags.
        risk: Probability that it is unsafe; 0 if that is accepted.
        leaf: The value of the state reached, where that is a leaf that has one.
    """

    target: State
    reward: float
    flags: int
    risk: float
    leaf: float = 0.0


EdgeLayer = list[list[FollowedEdge]]
ExpandedGraph = tuple[State, list[EdgeLayer], list[list[list[int]]], bool]
"""A state, the edges of each layer, the nodes that they lead to, and whether no budget was met."""


class SearchLimits(NamedTuple):
    """Limits of a search, and its treatment of rewards and risks; see `serp.PlannerSettings`."""

    actions: int
    depth: int
    discount: float
    accepted_risk: float
    max_nodes: int
    max_edges: int

    @classmethod
    def of(cls, data: Entry, actions: int) -> SearchLimits:
        """Return the limits of a planner for so many ground actions."""
        return cls(
            actions, data["depth"].whole(1), data["discount"].number(),
            data["accepted_risk"].number(), data["max_nodes"].whole(1), data["max_edges"].whole(1),
        )  # fmt: skip

    @property
    def tree(self) -> int:
        """Steps of the model in the whole tree, or more than its budget if it does not fit."""
        nodes, layer = 0, 1
        for _ in range(self.depth):
            nodes += layer
            layer *= self.actions
            if nodes > self.max_nodes or nodes * self.actions > self.max_edges:
                return self.max_edges + 1
        return nodes * self.actions

    @property
    def unbounded(self) -> bool:
        """Whether the whole tree fits into the budgets, so that no part of it can be left out."""
        return self.tree <= self.max_edges


class PathSearch:
    """The lookahead of a policy, for one state after the other."""

    def __init__(self, limits: SearchLimits, step: Step) -> None:
        self._limits, self._step = limits, step
        self._order = list(range(limits.actions))
        self._kept: ExpandedGraph | None = None
        """The graph of the newest state, which is asked for with other leaf values, too."""

    def edge(self, state: State, action: int) -> FollowedEdge:
        """Follow an edge of the planning graph."""
        out, flags = self._step(state, action)
        reward = out.pop()
        risk = self._step_risk(flags)
        flags = self._marked(flags, risk)
        return FollowedEdge(out, reward, flags, risk)

    def _step_risk(self, flags: int) -> float:
        if flags & UNSAFE:
            return 1.0
        risk = (flags >> RISK_SHIFT) * RISK_UNIT
        return risk if risk > self._limits.accepted_risk else 0.0

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
        return self._safe_from(first.target, self._limits.depth - 1)

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

    def forecast(
        self, state: State, leaves: LeafValues | None = None, widest: int | None = None
    ) -> Prospects | None:
        """Return the predictions for every ground action.

        Args:
            state: The state.
            leaves: Gives the values of the last layer.
            widest: Most states in a layer; None for any number.

        Returns:
            None where a layer has more states.
        """
        if self._kept is None or self._kept[0] != state:
            self._kept = self._expanded(state, widest)
        if self._kept is None:
            return None
        _, layers, children, complete = self._kept
        if leaves is not None and len(layers) == self._limits.depth:
            layers = [*layers[:-1], _with_values(layers[-1], leaves)]
        return self._best(layers, children, complete)

    def _expanded(self, state: State, widest: int | None) -> ExpandedGraph | None:
        layers: list[EdgeLayer] = []
        children: list[list[list[int]]] = []
        layer, applied, complete = [state], 0, True
        while len(layers) < self._limits.depth and layer:
            if widest is not None and len(layer) > widest:
                return None
            if sum(map(len, layers)) + len(layer) > self._limits.max_nodes:
                complete = False
                break
            edges = [[self.edge(each, a) for a in range(self._limits.actions)] for each in layer]
            applied += sum(edge.flags & APPLICABLE for of_node in edges for edge in of_node)
            if applied > self._limits.max_edges and layers:
                complete = False
                break
            layer, known = [], [[-1] * self._limits.actions for _ in edges]
            if len(layers) + 1 < self._limits.depth:
                layer, known = _distinct(edges)
            layers.append(edges)
            children.append(known)
        return state, layers, children, complete

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
                top, undefined, chance = (0.0, SAFE, 0.0), False, False
                of_actions: list[tuple[float, float, int]] = []
                for action, edge in enumerate(edges):
                    if not edge.flags & APPLICABLE:
                        undefined = undefined or bool(edge.flags & UNDEFINED)
                        of_actions.append((-math.inf, 1.0, -1))
                        continue
                    total = edge.reward + self._limits.discount * edge.leaf
                    danger, safe = edge.risk, SAFE
                    child = targets[action]
                    if 0 <= child < len(below):
                        next_risk, next_steps, next_value = below[child]
                        total += self._limits.discount * next_value
                        danger += (1.0 - danger) * next_risk
                        safe = next_steps if next_steps == SAFE else next_steps + 1
                    if edge.risk > 0.0:
                        safe = 0
                    of_actions.append((total, danger, safe))
                    score = -rank_of(edge.flags), -danger, safe, total
                    if chosen < 0 or score > best:
                        chosen, best, top = action, score, (danger, safe, total)
                    chance = chance or 0.0 < danger < 1.0
                if chance and self._limits.accepted_risk > 0.0:
                    chosen, top = self._counted(edges, of_actions, chosen)
                if chosen < 0 and undefined:
                    top = (1.0, 0, 0.0)
                here.append(top)
                if depth == 0:
                    return Prospects(
                        chosen,
                        [value for value, _, _ in of_actions],
                        [risk for _, risk, _ in of_actions],
                        [steps for _, _, steps in of_actions],
                        [edge.reward if edge.flags & APPLICABLE else 0.0 for edge in edges],
                        [edge.flags for edge in edges],
                        complete,
                    )
            below = here
        raise AssertionError("the first layer is always expanded")

    def _counted(
        self, edges: list[FollowedEdge], of_actions: list[tuple[float, float, int]], safest: int
    ) -> tuple[int, tuple[float, int, float]]:
        """Let accepted risks count as the least; return the best action and its path."""
        most, least, steps = of_actions[safest]
        chosen = safest
        rank = rank_of(edges[safest].flags)
        for action, edge in enumerate(edges):
            value, danger, _ = of_actions[action]
            same = edge.flags & APPLICABLE and rank_of(edge.flags) == rank
            if same and danger < 1.0 and danger <= least + self._limits.accepted_risk:
                of_actions[action] = value, least, steps
                if value > most or (value == most and action < chosen):
                    chosen, most = action, value
        return chosen, (least, steps, most)


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


def _with_values(edges: EdgeLayer, leaves: LeafValues) -> EdgeLayer:
    """Return edges with the values of the states that they lead to."""
    ends = [
        (k, a)
        for k, of_node in enumerate(edges)
        for a, edge in enumerate(of_node)
        if edge.flags & APPLICABLE and not edge.flags & TERMINAL
    ]
    values = leaves([edges[k][a].target for k, a in ends])
    valued = [of_node.copy() for of_node in edges]
    for (k, a), value in zip(ends, values, strict=True):
        valued[k][a] = edges[k][a]._replace(leaf=value)
    return valued
