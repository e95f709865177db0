"""Monitor-replanning (MrP): monitor, expand, choose the best path, execute its first action.

Paper, section 3.2, after Russell & Norvig's execution monitoring and replanning.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from serp.errors import SettingsError
from serp.model.flags import APPLICABLE, RISKY, TERMINAL, UNSAFE, risk_of
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.forecast import SAFE, Forecast
from serp.planning.lookahead import BestPath, Lookahead
from serp.planning.preference import marked, step_risk
from serp.settings import PlannerSettings

if TYPE_CHECKING:
    import networkx as nx

State = tuple[float, ...]

MAX_EDGES: Final = 400_000
"""Most edges of a graph, beyond the first layer: they are objects, and take some seconds."""


class Edge(NamedTuple):
    """An edge of the planning graph: one control period of an action.

    Attributes:
        source, action, target: Positions of nodes and action.
        reward: Its reward.
        flags: Its flags, with RISKY where its risk is not accepted.
        chance: Probability of what the file says, where something else is likelier; else 0.
        written: The node that the file leads to then; -1 for none.
    """

    source: int
    action: int
    target: int
    reward: float
    flags: int
    chance: float = 0.0
    written: int = -1


class PlanningGraph:
    """The graph of a state `[F]`, the root.

    Equal states of one layer are one node. A state in which the task has ended is not expanded, and
    is a different node from the same state in which the task goes on. Beyond the first layer there
    are at most `MAX_EDGES` edges.

    Attributes:
        forecast: The forecast for the root.
        states: The states of all nodes.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings, state: Vector) -> None:
        most = max(1, min(settings.max_nodes, MAX_EDGES // max(1, len(model.actions))))
        lookahead = Lookahead(model, settings.replace(max_nodes=most))
        self.model = model
        self.settings = settings
        self.forecast = lookahead.forecast(state)
        self.states: list[State] = [tuple(state.tolist())]
        self._ended = [False]
        self._layer_of = [0]
        self._edges: list[dict[int, Edge]] = [{}]
        nodes = [0]
        expanded: list[int] = []
        for layer in range(1, self.forecast.depth + 1):
            first = len(self.states)
            self._expand(nodes, layer)
            expanded += nodes
            nodes = [node for node in range(first, len(self.states)) if not self._ended[node]]
        self._best = [BestPath(0.0, 0.0, SAFE, -1)] * len(self.states)
        for node, best in zip(expanded, lookahead.paths(), strict=True):
            self._best[node] = best

    def _expand(self, nodes: list[int], layer: int) -> None:
        """Add the edges out of some nodes, which lead to a layer."""
        known: dict[tuple[State, bool], int] = {}
        count, width = len(self.model.actions), len(self.model.fluents)
        states = np.array([self.states[node] for node in nodes]).reshape(len(nodes), width)
        sources, actions = np.repeat(nodes, count), np.tile(np.arange(count), len(nodes))
        out, flags, chances, written = self.model.core.steps(states)
        out, written = (each.reshape(-1, width + 1) for each in (out, written))
        flags, shares = flags.ravel(), chances.ravel().tolist()
        for k in np.flatnonzero(flags & APPLICABLE).tolist():
            *state, reward = out[k].tolist()
            bits, source, action = int(flags[k]), int(sources[k]), int(actions[k])
            target, other = self._node(tuple(state), (bits & TERMINAL) != 0, layer, known), -1
            if shares[k]:
                doubted = written[k, :-1].tolist()
                other = self._node(tuple(doubted), False, layer, known)
            marks = marked(bits, step_risk(bits, self.settings.accepted_risk))
            edge = Edge(source, action, target, reward, marks, shares[k], other)
            self._edges[source][action] = edge

    def _node(
        self, state: State, ended: bool, layer: int, known: dict[tuple[State, bool], int]
    ) -> int:
        """Return the node of a state, added unless it is known in this layer."""
        node = known.setdefault((state, ended), len(self.states))
        if node == len(self.states):
            self.states.append(state)
            self._ended.append(ended)
            self._layer_of.append(layer)
            self._edges.append({})
        return node

    @property
    def best_path(self) -> list[Edge]:
        """The edges of the best path from the root."""
        return self.path_by(self.forecast.choice)

    def path_by(self, action: int) -> list[Edge]:
        """Return the edges of the best path that begins with an action; none if not applicable."""
        path, node = list[Edge](), 0
        while (edge := self._edges[node].get(action)) is not None:
            path.append(edge)
            node, action = edge.target, self._best[edge.target].action
        return path

    def to_networkx(self) -> nx.MultiDiGraph:
        """Return the graph as a `networkx.MultiDiGraph`.

        Nodes are numbered from the root, 0. `state` is a tuple in the order of `graph["fluents"]`,
        `safe_steps` None for SAFE. The key of an edge is the position of its action; `unsafe` is
        by the file, `risky` says that `risk` is not accepted, `chosen` that the best path has it.
        `chance` and `written` are those of `Edge`.
        """
        import networkx as nx

        graph = nx.MultiDiGraph(fluents=tuple(f.name for f in self.model.fluents))
        names = [action.name for action in self.model.actions]
        nodes = zip(self._layer_of, self.states, self._ended, self._best, strict=True)
        for node, (layer, state, ended, best) in enumerate(nodes):
            graph.add_node(
                node, layer=layer, state=state, ended=ended, value=best.value, path_risk=best.risk,
                safe_steps=None if best.safe_steps == SAFE else best.safe_steps,
            )  # fmt: skip
        every = (edge for edges in self._edges for edge in edges.values())
        for source, action, target, reward, flags, chance, written in every:
            graph.add_edge(
                source, target, action, action=names[action], reward=reward,
                unsafe=(flags & UNSAFE) != 0, risk=risk_of(flags), risky=(flags & RISKY) != 0,
                chosen=False, chance=chance, written=written,
            )  # fmt: skip
        for edge in self.best_path:
            graph.edges[edge.source, edge.target, edge.action]["chosen"] = True
        return graph


class PlannedStep(NamedTuple):
    """A step of the chosen path: name of the action, what is predicted of it, state reached."""

    action: str
    reward: float
    unsafe: bool
    risk: float
    state: tuple[float, ...]


@dataclass(frozen=True)
class Plan:
    """One decision of the planner.

    Attributes:
        path: The chosen path.
        forecast: The prediction for every first action.
        planning_graph: The planning graph of the lookahead.
    """

    path: tuple[PlannedStep, ...]
    forecast: Forecast
    planning_graph: PlanningGraph = field(repr=False)

    @property
    def action(self) -> int | None:
        """Position of the chosen action, or None where none is applicable."""
        return self.forecast.choice if self.forecast.choice >= 0 else None

    @property
    def name(self) -> str | None:
        """Its name, or None."""
        return None if self.action is None else self.planning_graph.model.actions[self.action].name

    @property
    def reward(self) -> float:
        """Discounted sum of rewards along the chosen path."""
        return 0.0 if self.action is None else float(self.forecast.value[self.action])

    @property
    def safe(self) -> bool:
        """Whether every risk on the chosen path is accepted."""
        return self.forecast.safe

    @property
    def nodes(self) -> int:
        """Number of states in the planning graph."""
        return len(self.planning_graph.states)

    @property
    def paths(self) -> list[list[int]]:
        """The actions of the best path in the graph that begins with each action."""
        actions = range(len(self.forecast.flags))
        return [[edge.action for edge in self.planning_graph.path_by(k)] for k in actions]

    @functools.cached_property
    def graph(self) -> nx.MultiDiGraph:
        """The planning graph; see `PlanningGraph.to_networkx`."""
        return self.planning_graph.to_networkx()


class MonitorReplanner:
    """The planner of the paper, with its planning graph.

    A decision is a pure function of state and model.

    Args:
        model: The transition model.
        settings: Depth, discount, budget of nodes and accepted risk; the others do not count.
        changes: Other values of settings, such as `depth=3`.

    Raises:
        SettingsError: A setting is outside its range.
    """

    def __init__(
        self, model: TransitionModel, settings: PlannerSettings | None = None, **changes: Any
    ) -> None:
        if not isinstance(model, TransitionModel):
            raise SettingsError(
                f"planner: model must be a TransitionModel such as `domain.model`, not {model!r}"
            )
        self.model = model
        self.settings = (settings or PlannerSettings()).replace(**changes)

    def plan(self, state: ArrayLike) -> Plan:
        """Plan from an observed state `[F]`.

        Raises:
            StateError: The state does not fit the model.
        """
        graph = PlanningGraph(self.model, self.settings, self.model.check_state(state))
        path = [
            PlannedStep(
                self.model.actions[action].name, reward, bool(flags & UNSAFE), risk_of(flags),
                graph.states[target],
            )
            for _, action, target, reward, flags, *_ in graph.best_path
        ]  # fmt: skip
        return Plan(tuple(path), graph.forecast, graph)
