"""The planning graph: layered, rooted, states as nodes, actions as edges (paper, section 3.2)."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import NamedTuple

import networkx as nx
import numpy as np

from serp.domain.codegen import APPLICABLE, TERMINAL, UNSAFE
from serp.domain.model import TransitionModel, Vector
from serp.planning.forecast import SAFE, Forecast
from serp.planning.settings import Bound, PlannerSettings

State = tuple[float, ...]
_CHUNK = 64


class Edge(NamedTuple):
    """One edge: positions of its nodes and action, discounted reward, flags of the whole edge."""

    source: int
    action: int
    target: int
    reward: float
    flags: int


class _Layer(NamedTuple):
    """The edges out of one layer, column by column.

    Edge `k` leaves `nodes[k // A]` by action `k % A`; its target is -1 where the action is not
    applicable. Columns instead of objects: a decision makes thousands of edges, a reader looks at
    a handful.
    """

    nodes: list[int]
    target: list[int]
    reward: list[float]
    weight: list[float]
    flags: list[int]
    periods: list[int]
    first_reward: list[float]
    first_flags: list[int]


class PlanningGraph:
    """Expands the graph of one state layer by layer and values it by a backward pass.

    Equal states of one layer are one node. A node that an action reaches by ending the task is
    not expanded and is kept apart from one with the same state that goes on.

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
        self._layers: list[_Layer] = []
        self._value: list[float] = []
        self._safe_steps: list[int] = []
        self._best: list[int] = []

    @property
    def depth(self) -> int:
        """Layers that are expanded."""
        return len(self._layers)

    def grow(self, deadline: float | None = None) -> None:
        """Expand until the depth, the node budget or the deadline (`time.perf_counter`) is met.

        A layer that is not complete at the deadline is dropped; the first one is always finished.
        """
        budget = self.settings.node_budget(len(self.model.actions))
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
            layer = self._follow(open_nodes, deadline if self.depth else None)
            if layer is None:
                self.bound = Bound.TIME
                return
            open_nodes = self._merge(*layer)

    def _merge(self, layer: _Layer, reached: list[State]) -> list[int]:
        """Add a layer: find or make the target of every edge; return the nodes that go on."""
        going_on: dict[State, int] = {}
        ended: dict[State, int] = {}
        states, targets = self.states, layer.target
        first = len(states)
        for state, flags in zip(reached, layer.flags, strict=True):
            if not flags & APPLICABLE:
                targets.append(-1)
                continue
            known = ended if flags & TERMINAL else going_on
            target = known.get(state)
            if target is None:
                target = known[state] = len(states)
                states.append(state)
            targets.append(target)
        self._layers.append(layer)
        self._layer_of += [self.depth] * (len(states) - first)
        self._ended.update(ended.values())
        return list(going_on.values())

    def _follow(
        self, nodes: list[int], deadline: float | None
    ) -> tuple[_Layer, list[State]] | None:
        """Follow every edge of the nodes.

        Returns:
            The layer, targets still missing, and the states reached; None at the deadline.
        """
        layer = _Layer(nodes, [], [], [], [], [], [], [])
        reached: list[State] = []
        follow = self._follow_native if self.model.compiles else self._follow_interpreted
        # Without a deadline there is no reason to stop in between.
        chunk = len(nodes) if deadline is None else _CHUNK
        for start in range(0, len(nodes), chunk):
            if deadline is not None and time.perf_counter() >= deadline:
                return None
            reached += follow([self.states[n] for n in nodes[start : start + chunk]], layer)
        return layer, reached

    def _follow_native(self, sources: list[State], layer: _Layer) -> Iterable[State]:
        from serp.domain.native import address_of
        from serp.planning import kernels

        model, settings = self.model, self.settings
        actions, width = len(model.actions), len(model.fluents)
        edges = len(sources) * actions
        states = np.zeros((len(sources), width + 1))
        states[:, :width] = sources
        out = np.empty((edges + 1, width + 1))
        numbers = np.empty((3, edges))
        flags = np.empty((3, edges), dtype=np.int64)
        kernels.expand(
            address_of(model.native_step()), states.reshape(-1), len(sources), actions,
            settings.repeat, settings.discount, model.theta, model.dt, out.reshape(-1),
            numbers[0], numbers[1], flags[0], flags[1], numbers[2], flags[2],
        )  # fmt: skip
        layer.reward.extend(numbers[0].tolist())
        layer.weight.extend(numbers[1].tolist())
        layer.flags.extend(flags[0].tolist())
        layer.periods.extend(flags[1].tolist())
        layer.first_reward.extend(numbers[2].tolist())
        layer.first_flags.extend(flags[2].tolist())
        return map(tuple, out[:-1, :width].tolist())

    def _follow_interpreted(self, sources: list[State], layer: _Layer) -> Iterable[State]:
        """The same in CPython, for domains too large to be compiled in reasonable time."""
        reached: list[State] = []
        for source in sources:
            for action in range(len(self.model.actions)):
                state, reward, weight, flags, periods, first_reward, first_flags = self._edge(
                    list(source), action
                )
                reached.append(tuple(state))
                layer.reward.append(reward)
                layer.weight.append(weight)
                layer.flags.append(flags)
                layer.periods.append(periods)
                layer.first_reward.append(first_reward)
                layer.first_flags.append(first_flags)
        return reached

    def _edge(
        self, source: list[float], action: int
    ) -> tuple[list[float], float, float, int, int, float, int]:
        """Follow one edge; see `serp.planning.kernels.edge`, which does the same."""
        state, flags = self.model.transition(source, action)
        reward = first_reward = state.pop()
        first_flags, weight = flags, self.settings.discount
        periods = 0 if flags & UNSAFE else 1
        for _ in range(self.settings.repeat - 1):
            if not flags & APPLICABLE or flags & TERMINAL:
                break
            further, again = self.model.transition(state, action)
            if not again & APPLICABLE:
                break
            reward += weight * further.pop()
            weight *= self.settings.discount
            flags |= again
            if not flags & UNSAFE:
                periods += 1
            state = further
        return state, reward, weight, flags, periods, first_reward, first_flags

    def evaluate(self) -> Forecast:
        """Value every node from the last layer back to the root.

        `networkx.dag_longest_path` would not do: it is not rooted and drops prefixes with a
        negative sum.
        """
        size, actions = len(self.states), len(self.model.actions)
        self._value = values = [0.0] * size
        self._safe_steps = steps = [SAFE] * size
        self._best = [-1] * size
        for layer in reversed(self._layers):
            edge = 0
            for node in layer.nodes:
                chosen, top_value, top_steps = -1, 0.0, SAFE
                for action in range(actions):
                    target = layer.target[edge]
                    if target >= 0:
                        total = layer.reward[edge] + layer.weight[edge] * values[target]
                        safe = steps[target]
                        if layer.flags[edge] & UNSAFE:
                            safe = layer.periods[edge]
                        elif safe != SAFE:
                            safe += layer.periods[edge]
                        if (
                            chosen < 0
                            or safe > top_steps
                            or (safe == top_steps and total > top_value)
                        ):
                            chosen, top_value, top_steps = action, total, safe
                    edge += 1
                values[node], steps[node], self._best[node] = top_value, top_steps, chosen
        return self._forecast()

    def _forecast(self) -> Forecast:
        root = self._layers[0]
        value = np.full(len(root.target), -np.inf)
        steps = np.full(len(root.target), -1, dtype=np.int64)
        reward = np.zeros(len(root.target))
        flags = np.zeros(len(root.target), dtype=np.int64)
        for action, target in enumerate(root.target):
            if target < 0:
                continue
            value[action] = root.reward[action] + root.weight[action] * self._value[target]
            steps[action] = self._edge_steps(root.flags[action], root.periods[action], target)
            reward[action], flags[action] = root.first_reward[action], root.first_flags[action]
        return Forecast(self._best[0], value, steps, reward, flags, self.depth, self.bound)

    def _edge_steps(self, flags: int, periods: int, target: int) -> int:
        """Return the safe control periods of the best path through an edge."""
        if flags & UNSAFE:
            return periods
        following = self._safe_steps[target]
        return SAFE if following == SAFE else following + periods

    def best_path(self) -> list[Edge]:
        """Return the edges of the best path from the root, after `evaluate`."""
        actions = len(self.model.actions)
        path: list[Edge] = []
        node = 0
        for layer in self._layers:
            action = self._best[node]
            if action < 0:
                break
            edge = layer.nodes.index(node) * actions + action
            path.append(
                Edge(node, action, layer.target[edge], layer.reward[edge], layer.flags[edge])
            )
            node = path[-1].target
        return path

    def to_networkx(self) -> nx.MultiDiGraph:
        """Return the graph as a `networkx.MultiDiGraph`.

        Nodes are numbered from the root, 0, with attributes `layer`, `state` (tuple in the order
        of `graph["fluents"]`), `ended`, `value` and `safe_steps` (None for SAFE); the key of an
        edge is the position of its action, its attributes are `action` (name), `reward`,
        `unsafe` and `chosen` (on the best path).
        """
        graph = nx.MultiDiGraph(fluents=tuple(f.name for f in self.model.fluents))
        names = [action.name for action in self.model.actions]
        actions = range(len(names))
        # The dictionaries are filled as `add_edge` would fill them: its checks, edge by edge,
        # would cost several times what the planning does (a test compares the two).
        successors, predecessors = graph._succ, graph._pred
        graph._node.update(
            (
                node,
                {
                    "layer": layer,
                    "state": state,
                    "ended": node in self._ended,
                    "value": value,
                    "safe_steps": None if steps == SAFE else steps,
                },
            )
            for node, (state, layer, value, steps) in enumerate(
                zip(self.states, self._layer_of, self._value, self._safe_steps, strict=True)
            )
        )
        successors.update((node, {}) for node in range(len(self.states)))
        predecessors.update((node, {}) for node in range(len(self.states)))
        for layer in self._layers:
            edges = zip(layer.target, layer.reward, layer.flags, strict=True)
            for node in layer.nodes:
                following = successors[node]
                for action, (target, reward, flags) in zip(actions, edges, strict=False):
                    if target < 0:
                        continue
                    attributes = {
                        "action": names[action],
                        "reward": reward,
                        "unsafe": (flags & UNSAFE) != 0,
                        "chosen": False,
                    }
                    if target in following:
                        following[target][action] = attributes
                    else:
                        following[target] = predecessors[target][node] = {action: attributes}
        for edge in self.best_path():
            successors[edge.source][edge.target][edge.action]["chosen"] = True
        return graph
