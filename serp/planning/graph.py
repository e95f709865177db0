"""The planning graph: layered, rooted, states as nodes, actions as edges (paper, section 3.2).

`Lookahead` expands and evaluates it on arrays. Here its edges are followed once more, as objects.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import networkx as nx
import numpy as np

from serp.model.flags import APPLICABLE, RISKY, TERMINAL, UNSAFE, risk_of
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.edge_kernels import expand
from serp.planning.forecast import SAFE
from serp.planning.kernel_records import Rules
from serp.planning.limits import Bound
from serp.planning.lookahead import Lookahead
from serp.planning.preference import PathScore, counted, path_score
from serp.settings import PlannerSettings

State = tuple[float, ...]

_EDGES: Final = 4096
"""Edges that are followed between two readings of the clock."""


class Edge(NamedTuple):
    """An edge: positions of its nodes and action, and what `serp.planning.edge_kernels` finds.

    Attributes:
        source, action, target: Positions.
        reward: Discounted sum of the rewards of its control periods.
        weight: Weight of the rewards after it.
        flags: Flags of the whole edge.
        rank: `serp.planning.preference.rank_of` its first control period.
        periods: Its control periods; those before the first with a risk, if any has one.
        risk: Probability that it is unsafe, without the steps whose risk is accepted.
    """

    source: int
    action: int
    target: int
    reward: float
    weight: float
    flags: int
    rank: int
    periods: int
    risk: float


class PlanningGraph:
    """The graph of one state.

    Equal states of one layer are one node. A state in which the task has ended is not expanded, and
    is a different node from the same state in which the task goes on.

    Args:
        model: The transition model.
        settings: Depth, discount and bounds.
        state: The root, `[F]`.
        deadline: When to end (`time.perf_counter`): the last complete layer counts. The first one
            is always completed.

    Attributes:
        forecast: The forecast for the root.
        states: The states of all nodes.
    """

    def __init__(
        self,
        model: TransitionModel,
        settings: PlannerSettings,
        state: Vector,
        deadline: float = math.inf,
    ) -> None:
        lookahead = Lookahead(model, settings)
        self.model = model
        self.settings = settings
        self.forecast = lookahead.forecast(state)
        self.states: list[State] = [tuple(state.tolist())]
        self._ended = [False]
        self._layer_of = [0]
        self._edges: list[list[Edge]] = [[]]
        nodes = [0]
        rows: list[int] = []  # the node of each row of the lookahead's arrays
        for layer in range(1, self.forecast.depth + 1):
            first = len(self.states)
            rows += nodes
            if not self._expand(nodes, layer, deadline):
                rows = rows[: -len(nodes)]
                lookahead = Lookahead(model, settings.replace(depth=layer - 1))
                self.forecast = lookahead.forecast(state)._replace(bound=Bound.TIME)
                break
            nodes = [node for node in range(first, len(self.states)) if not self._ended[node]]
        self._scores = [path_score(0, 0.0, SAFE, 0.0)] * len(self.states)
        for node, score in zip(rows, lookahead.scores(len(rows)), strict=True):
            self._scores[node] = score

    def _expand(self, nodes: list[int], layer: int, deadline: float) -> bool:
        """Add the edges out of some nodes, a layer; return whether there was time for it.

        If not, nothing is added.
        """
        first, known = len(self.states), dict[tuple[State, bool], int]()
        size = max(1, _EDGES // max(1, len(self.model.actions)))
        for start in range(0, len(nodes), size):
            if layer > 1 and time.perf_counter() >= deadline:
                for column in (self.states, self._ended, self._layer_of, self._edges):
                    del column[first:]
                for node in nodes:
                    self._edges[node] = []
                return False
            for source, action, state, columns in self._follow(nodes[start : start + size]):
                ended = (columns[2] & TERMINAL) != 0
                target = known.setdefault((state, ended), len(self.states))
                if target == len(self.states):
                    self.states.append(state)
                    self._ended.append(ended)
                    self._layer_of.append(layer)
                    self._edges.append([])
                self._edges[source].append(Edge(source, action, target, *columns))
        return True

    def _follow(self, nodes: list[int]) -> Iterator[tuple[int, int, State, tuple[Any, ...]]]:
        """Yield node, action, state reached and what else is known of the edges out of nodes."""
        settings, actions, width = self.settings, len(self.model.actions), len(self.model.fluents)
        tried = len(nodes) * actions
        rows = np.zeros((len(nodes), width + 1))
        rows[:, :width] = [self.states[node] for node in nodes]
        out = np.empty((tried + 1, width + 1))
        reward, weight, risk = np.empty((3, tried))
        flags, rank, periods = np.empty((3, tried), dtype=np.int64)
        columns = (reward, weight, flags, rank, periods, risk)
        expand(
            self.model.machine_code,
            tuple(Rules(actions, 1, settings.repeat, settings.discount, settings.accepted_risk)),
            len(nodes), rows.reshape(-1), out.reshape(-1), columns,
        )  # fmt: skip
        there = np.flatnonzero(flags & APPLICABLE)
        found = zip(*(column[there].tolist() for column in columns), strict=True)
        states = map(tuple, out[there, :width].tolist())
        for e, state, numbers in zip(there.tolist(), states, found, strict=True):
            yield nodes[e // actions], e % actions, state, numbers

    @functools.cached_property
    def best_path(self) -> list[Edge]:
        """The edges of the best path from the root."""
        return self._best_path(self._edges[0])

    def path_by(self, action: int) -> list[Edge]:
        """Return the edges of the best path from the root that begins with an action.

        It is empty where the action is not applicable.
        """
        return self._best_path([edge for edge in self._edges[0] if edge.action == action])

    def _best_path(self, edges: list[Edge]) -> list[Edge]:
        path = list[Edge]()
        while edges:
            scores = counted([self._through(edge) for edge in edges], self.settings.accepted_risk)
            path.append(edges[max(range(len(edges)), key=scores.__getitem__)])
            edges = self._edges[path[-1].target]
        return path

    def _through(self, edge: Edge) -> PathScore:
        """Return the score of the best path that begins with an edge."""
        _, spared, safe, value = self._scores[edge.target]
        steps = edge.periods if edge.risk > 0.0 or safe != SAFE else SAFE
        if edge.risk == 0.0 and safe != SAFE:
            steps += safe
        risk = edge.risk - (1.0 - edge.risk) * spared
        return path_score(edge.rank, risk, steps, edge.reward + edge.weight * value)

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
                ended=self._ended[node],
                value=value,
                path_risk=0.0 - spared,
                safe_steps=None if steps == SAFE else steps,
            )
        for edge in (edge for edges in self._edges for edge in edges):
            graph.add_edge(
                edge.source,
                edge.target,
                edge.action,
                action=names[edge.action],
                reward=edge.reward,
                unsafe=(edge.flags & UNSAFE) != 0,
                risk=risk_of(edge.flags),
                risky=(edge.flags & RISKY) != 0,
                chosen=False,
            )
        for edge in self.best_path:
            graph.edges[edge.source, edge.target, edge.action]["chosen"] = True
        return graph
