"""Slow, obvious planners to hold the fast ones against: plain recursion, no merging, no arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import networkx as nx

from serp.domain.flags import UNDEFINED
from serp.domain.model import TransitionModel, Vector
from serp.planning.forecast import SAFE
from serp.planning.settings import Bound, PlannerSettings

State = tuple[float, ...]


@dataclass(frozen=True)
class Arc:
    """An action followed for `repeat` control periods, or until it cannot go on."""

    action: int
    state: State
    reward: float
    weight: float
    unsafe: bool
    ended: bool
    steps: int
    """Control periods before the first unsafe one, or all of them."""


@dataclass(frozen=True)
class Path:
    """A path with what it promises; `steps`: control periods before the first unsafe one."""

    steps: int
    value: float
    arcs: tuple[Arc, ...]

    def better_than(self, other: Path) -> bool:
        """Safe for longer, then more reward; of equals neither is better."""
        return (self.steps, self.value) > (other.steps, other.value)


END = Path(SAFE, 0.0, ())
UNKNOWN = Path(0, 0.0, ())


@dataclass(frozen=True)
class Reference:
    """Monitor-replanning by the book.

    `leaf`: what a state is worth that the last layer leads to and that is no end; None: nothing.
    The recursion takes the layers that it is given for all of them.
    """

    model: TransitionModel
    settings: PlannerSettings
    leaf: Callable[[State], float] | None = None

    def arc(self, state: State, action: int) -> Arc | None:
        """Follow one action; None where it is not applicable."""
        reward, weight, unsafe, ended, steps = 0.0, 1.0, False, False, 0
        for period in range(self.settings.repeat):
            outcome = self.model.step(state, action)
            if not outcome.applicable:
                if period == 0:
                    return None
                break
            # The first reward is taken as it is: 0.0 + -0.0 would lose its sign.
            reward = outcome.reward if period == 0 else reward + weight * outcome.reward
            weight *= self.settings.discount
            unsafe |= outcome.unsafe
            steps += not unsafe
            state, ended = tuple(outcome.state.tolist()), outcome.terminal
            if ended:
                break
        return Arc(action, state, reward, weight, unsafe, ended, steps)

    def arcs(self, state: State) -> list[Arc]:
        """Every action that is applicable, in the order of the file."""
        found = [self.arc(state, action) for action in range(len(self.model.actions))]
        return [arc for arc in found if arc is not None]

    def layers(self, root: State) -> tuple[int, Bound]:
        """How many layers are expanded, and what ends that."""
        budget = self.settings.node_budget(len(self.model.actions))
        edge_budget = self.settings.edge_budget(len(self.model.fluents))
        frontier, expanded, edges = {root}, 0, 0
        for depth in range(self.settings.depth):
            if not frontier:
                return depth, Bound.EXHAUSTED
            expanded += len(frontier)
            if depth and expanded > budget:
                return depth, Bound.NODES
            found = [arc for state in frontier for arc in self.arcs(state)]
            edges += len(found)
            if depth and edges > edge_budget:
                return depth, Bound.NODES
            frontier = {arc.state for arc in found if not arc.ended}
        return self.settings.depth, Bound.DEPTH

    def along(self, arc: Arc, layers: int) -> Path:
        """The best path that begins with an arc and goes on for some layers."""
        if arc.ended:
            return put_before(arc, END)
        return put_before(arc, self.best(arc.state, layers) if layers else self.beyond(arc.state))

    def beyond(self, state: State) -> Path:
        """What is expected where nobody looks."""
        return END if self.leaf is None else Path(SAFE, self.leaf(state), ())

    def best(self, state: State, layers: int) -> Path:
        """The best path from a state; the first in the file among equals."""
        best: Path | None = None
        for arc in self.arcs(state):
            path = self.along(arc, layers - 1)
            if best is None or path.better_than(best):
                best = path
        return best or (UNKNOWN if self.unpredictable(state) else END)

    def unpredictable(self, state: State) -> bool:
        """Whether some action has an undefined result there."""
        count = len(self.model.actions)
        flags = [self.model.transition(list(state), action)[1] for action in range(count)]
        return any(f & UNDEFINED for f in flags)

    def paths(self, state: State, layers: int) -> Iterator[Path]:
        """Every path there is."""
        arcs = self.arcs(state) if layers else []
        if not arcs:
            yield UNKNOWN if layers and self.unpredictable(state) else END
        for arc in arcs:
            for rest in [END] if arc.ended else self.paths(arc.state, layers - 1):
                yield put_before(arc, rest)

    def graph(self, root: State, layers: int) -> nx.MultiDiGraph:
        """The planning graph with merged states, edge by edge through networkx's own methods."""
        graph = nx.MultiDiGraph(fluents=tuple(f.name for f in self.model.fluents))

        def add(state: State, layer: int, ended: bool) -> int:
            path = END if ended else self.best(state, layers - layer) if layer < layers else END
            graph.add_node(
                len(graph),
                layer=layer,
                state=state,
                ended=ended,
                value=path.value,
                safe_steps=None if path.steps == SAFE else path.steps,
            )
            return len(graph) - 1

        frontier = [add(root, 0, False)]
        for layer in range(layers):
            known: dict[tuple[State, bool], int] = {}
            for source in frontier:
                for arc in self.arcs(graph.nodes[source]["state"]):
                    key = (arc.state, arc.ended)
                    if key not in known:
                        known[key] = add(arc.state, layer + 1, arc.ended)
                    graph.add_edge(
                        source,
                        known[key],
                        key=arc.action,
                        action=self.model.actions[arc.action].name,
                        reward=arc.reward,
                        unsafe=arc.unsafe,
                        chosen=False,
                    )
            frontier = [node for (_, ended), node in known.items() if not ended]
        node = 0
        for arc in self.best(root, layers).arcs:
            target = next(t for _, t, key in graph.out_edges(node, keys=True) if key == arc.action)
            graph.edges[node, target, arc.action]["chosen"] = True
            node = target
        return graph


def put_before(arc: Arc, rest: Path) -> Path:
    """The path that begins with an arc."""
    steps = arc.steps if arc.unsafe else SAFE if rest.steps == SAFE else rest.steps + arc.steps
    return Path(steps, arc.reward + arc.weight * rest.value, (arc, *rest.arcs))


def as_state(state: Vector) -> State:
    """A row of numbers as a state."""
    return tuple(state.tolist())
