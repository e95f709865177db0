"""The planning graph: layered, rooted, states as nodes, actions as edges (paper, section 3.2)."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import NamedTuple

import networkx as nx
import numpy as np

from serp.model.flags import RISKY, TERMINAL, UNSAFE, risk_of
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.expansion import Edges, State, follow
from serp.planning.forecast import SAFE, Forecast
from serp.planning.limits import Bound, edge_budget, node_budget
from serp.planning.preference import PathScore, path_score
from serp.settings import PlannerSettings

_END = path_score(0, 0.0, SAFE, 0.0)
_UNKNOWN = path_score(0, 1.0, 0, 0.0)


class Edge(NamedTuple):
    """One edge: positions of its nodes and action, discounted reward, flags of the whole edge."""

    source: int
    action: int
    target: int
    reward: float
    flags: int


class _GraphLayer(NamedTuple):
    """The edges out of the nodes of one layer, and the node that each leads to."""

    nodes: list[int]
    edges: Edges
    target: list[int]


class PlanningGraph:
    """Expands the graph of one state layer by layer and evaluates it by a backward pass.

    Equal states of one layer are one node. A state in which the task has ended is not expanded, and
    is a different node from the same state in which the task goes on.

    Args:
        model: The transition model.
        settings: Depth, discount and bounds.
        state: The root, `[F]`.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings, state: Vector) -> None:
        self.model = model
        self.settings = settings
        self.bound = Bound.DEPTH
        self.states: list[State] = [tuple(state.tolist())]
        self._layer_of = [0]
        self._ended: set[int] = set()
        self._unpredictable: set[int] = set()
        self._layers: list[_GraphLayer] = []
        self._scores: list[PathScore] = []
        self._best: list[int] = []

    @property
    def depth(self) -> int:
        """Number of expanded layers."""
        return len(self._layers)

    def grow(self, deadline: float | None = None) -> None:
        """Expand until the depth, a budget or the deadline (`time.perf_counter`) is reached.

        An incomplete layer is dropped; the first layer is always completed.
        """
        budget = node_budget(self.settings.max_nodes, len(self.model.actions))
        open_nodes = [0]
        expanded = 0
        while self.depth < self.settings.depth:
            if not open_nodes:
                self.bound = Bound.EXHAUSTED
                return
            expanded += len(open_nodes)
            if self.depth and expanded > budget:
                self.bound = Bound.NODES
                return
            if isinstance(reached := self._expand(open_nodes, deadline), Bound):
                self.bound = reached
                return
            open_nodes = reached

    def _expand(self, nodes: list[int], deadline: float | None) -> list[int] | Bound:
        """Add the layer of edges out of some nodes and return the nodes to expand next.

        If a bound is reached, nothing is added and the bound returned.
        """
        first, bounded = len(self.states), bool(self._layers)
        edges_left = edge_budget(len(self.model.fluents)) - sum(
            len(layer.target) for layer in self._layers
        )
        layer = _GraphLayer(nodes, Edges.none(), [])
        going_on: dict[State, int] = {}
        ended: dict[State, int] = {}
        states, targets = self.states, layer.target
        undefined: set[int] = set()
        for edges, reached, doubtful in follow(self.model, self.settings, nodes, states):
            undefined.update(doubtful)
            for state, flags in zip(reached, edges.flags, strict=True):
                known = ended if flags & TERMINAL else going_on
                target = known.get(state)
                if target is None:
                    target = known[state] = len(states)
                    states.append(state)
                targets.append(target)
            layer.edges.extend(edges)
            met = None
            if len(targets) > edges_left:
                met = Bound.NODES
            elif deadline is not None and time.perf_counter() >= deadline:
                met = Bound.TIME
            if met is not None and bounded:
                del states[first:]
                return met
        self._layers.append(layer)
        # Where only actions with an undefined result are left, no action is known to be safe.
        self._unpredictable |= undefined.difference(layer.edges.source)
        self._layer_of += [self.depth] * (len(states) - first)
        self._ended.update(ended.values())
        return list(going_on.values())

    def evaluate(self) -> Forecast:
        """Evaluate every node from the last layer back to the root.

        `networkx.dag_longest_path` is not applicable: it has no root and drops prefixes with a
        negative sum.
        """
        size = len(self.states)
        self._scores = scores = [_END] * size
        self._best = best = [-1] * size  # position of an edge in its layer
        for node in self._unpredictable:
            scores[node] = _UNKNOWN
        for layer in reversed(self._layers):
            for k, (source, found) in enumerate(
                zip(layer.edges.source, self._through(layer), strict=True)
            ):
                if best[source] < 0 or found > scores[source]:
                    scores[source], best[source] = found, k
        return self._forecast()

    def _through(self, layer: _GraphLayer) -> Iterator[PathScore]:
        """Yield the score of the best path that begins with each edge."""
        edges, scores = layer.edges, self._scores
        for target, rank, reward, weight, risk, safe in zip(
            layer.target, edges.rank, edges.reward, edges.weight, edges.risk, edges.periods,
            strict=True,
        ):  # fmt: skip
            _, spared, following, value = scores[target]
            if risk == 0.0:
                safe = SAFE if following == SAFE else following + safe
            yield path_score(rank, risk - (1.0 - risk) * spared, safe, reward + weight * value)

    def _forecast(self) -> Forecast:
        root, count = self._layers[0], len(self.model.actions)
        value = np.full(count, -np.inf)
        path_risk = np.ones(count)
        steps = np.full(count, -1, dtype=np.int64)
        reward = np.zeros(count)
        flags = np.zeros(count, dtype=np.int64)
        edges = root.edges
        for k, (action, found) in enumerate(zip(edges.action, self._through(root), strict=True)):
            _, spared, steps[action], value[action] = found
            path_risk[action] = 0.0 - spared
            reward[action], flags[action] = edges.first_reward[k], edges.first_flags[k]
        choice = edges.action[self._best[0]] if self._best[0] >= 0 else -1
        state = list(self.states[0])
        for action in np.flatnonzero(flags == 0).tolist():
            flags[action] = self.model.transition(state, action)[1]
        return Forecast(choice, value, path_risk, steps, reward, flags, self.depth, self.bound)

    def best_path(self) -> list[Edge]:
        """Return the edges of the best path from the root, after `evaluate`."""
        path: list[Edge] = []
        node = 0
        for layer in self._layers:
            k, edges = self._best[node], layer.edges
            if k < 0:
                break
            source, node = node, layer.target[k]
            path.append(Edge(source, edges.action[k], node, edges.reward[k], edges.flags[k]))
        return path

    def to_networkx(self) -> nx.MultiDiGraph:
        """Return the graph as a `networkx.MultiDiGraph`.

        Nodes are numbered from the root, 0, with attributes `layer`, `state` (tuple in the order
        of `graph["fluents"]`), `ended`, `value`, `path_risk` and `safe_steps` (None for SAFE);
        the key of an edge is the position of its action, its attributes are `action` (name),
        `reward`, `unsafe` (by the file), `risk` in [0, 1], `risky` (it is not accepted) and
        `chosen` (on the best path).
        """
        graph = nx.MultiDiGraph(fluents=tuple(f.name for f in self.model.fluents))
        names = [action.name for action in self.model.actions]
        for node, (_, spared, steps, value) in enumerate(self._scores):
            graph.add_node(
                node,
                layer=self._layer_of[node],
                state=self.states[node],
                ended=node in self._ended,
                value=value,
                path_risk=0.0 - spared,
                safe_steps=None if steps == SAFE else steps,
            )
        for layer in self._layers:
            edges = layer.edges
            for source, action, target, reward, flags in zip(
                edges.source, edges.action, layer.target, edges.reward, edges.flags, strict=True
            ):
                graph.add_edge(
                    source,
                    target,
                    action,
                    action=names[action],
                    reward=reward,
                    unsafe=(flags & UNSAFE) != 0,
                    risk=risk_of(flags),
                    risky=(flags & RISKY) != 0,
                    chosen=False,
                )
        for edge in self.best_path():
            graph.edges[edge.source, edge.target, edge.action]["chosen"] = True
        return graph
