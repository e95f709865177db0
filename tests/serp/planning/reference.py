"""Slow, obvious planners to hold the fast ones against: plain recursion, no merging, no arrays."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import networkx as nx
import numpy as np

from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED, UNSAFE
from serp.model.transition_model import TransitionModel
from serp.planning.forecast import SAFE, Bound
from serp.planning.lookahead import MAX_EDGES, edge_budget
from serp.settings import PlannerSettings

State = tuple[float, ...]


@dataclass(frozen=True)
class Arc:
    """A control period of an action; `rank` and `danger` leave accepted risks out, and `going` is
    the probability that the task goes on unless it has `ended`. With the probability `chance` the
    file is right, and leads to the state `written`, although another one is likelier."""

    action: int
    state: State
    reward: float
    unsafe: bool
    ended: bool
    rank: int
    danger: float
    risk: float
    going: float = 1.0
    chance: float = 0.0
    written: State = ()


@dataclass(frozen=True)
class Path:
    """A path with what it promises; `steps`: control periods before the first with a risk."""

    steps: int
    value: float
    arcs: tuple[Arc, ...]
    danger: float = 0.0

    @property
    def promise(self):
        """Better rank, less risk, without risk for longer, more reward: in that order."""
        return (-self.arcs[0].rank, -self.danger, self.steps, self.value)


END = Path(SAFE, 0.0, ())
UNKNOWN = Path(0, 0.0, (), 1.0)


@dataclass(frozen=True)
class Reference:
    """Monitor-replanning by the book.

    `leaf`: what a state is worth that the last layer leads to and that is no end; None: nothing.
    The recursion takes the layers that it is given for all of them.
    """

    model: TransitionModel
    settings: PlannerSettings
    leaf: Callable[[State], float] | None = None

    def arc(self, state, action):
        """Follow one action; None where it is not applicable."""
        out, flags = self.model.transition(list(state), action)
        if not flags & APPLICABLE:
            return None
        unsafe = bool(flags & UNSAFE)
        risk = 1.0 if unsafe else (flags >> 8) % 2**26 / 2**24
        danger = risk if risk > self.settings.accepted_risk else 0.0
        chances, written = self.model.core.steps(np.array([state], dtype=float))[2:]
        return Arc(
            action, tuple(out[:-1]), out[-1], unsafe, bool(flags & TERMINAL),
            2 if unsafe else int(danger > 0), danger, risk, 1.0 - (flags >> 34) / 65535,
            float(chances[0, action]), tuple(written[0, action, :-1].tolist()),
        )  # fmt: skip

    def arcs(self, state):
        """Every action that is applicable, in the order of the file."""
        found = [self.arc(state, action) for action in range(len(self.model.actions))]
        return [arc for arc in found if arc is not None]

    def layers(self, root):
        """How many layers are expanded, and what ends that."""
        budget = min(self.settings.max_nodes, MAX_EDGES // max(1, len(self.model.actions)))
        most_edges = edge_budget(len(self.model.fluents))
        frontier, expanded, edges = {root}, 0, 0
        for depth in range(self.settings.depth):
            if not frontier:
                return depth, Bound.EXHAUSTED
            expanded += len(frontier)
            if depth and expanded > budget:
                return depth, Bound.NODES
            found = [arc for state in frontier for arc in self.arcs(state)]
            edges += len(found) + sum(arc.chance > 0.0 for arc in found)
            if depth and edges > most_edges:
                return depth, Bound.NODES
            frontier = {arc.state for arc in found if not arc.ended}
            frontier |= {arc.written for arc in found if arc.chance > 0.0}
        return self.settings.depth, Bound.DEPTH

    def along(self, arc, layers):
        """The best path that begins with an arc and goes on for some layers."""

        def after(state):
            return self.best(state, layers) if layers else self.beyond(state)

        rest = END if arc.ended else after(arc.state)
        value = rest.value
        if arc.chance:
            value = (1.0 - arc.chance) * value + arc.chance * after(arc.written).value
        return self.put_before(arc, rest, value)

    def put_before(self, arc, rest, after):
        """The path that begins with an arc; `after` is what is expected to follow."""
        steps = 0 if arc.danger else SAFE if rest.steps == SAFE else rest.steps + 1
        danger = arc.danger + (1.0 - arc.danger) * rest.danger
        value = arc.reward + self.settings.discount * arc.going * after
        return Path(steps, value, (arc, *rest.arcs), danger)

    def beyond(self, state):
        """What is expected where nobody looks."""
        return END if self.leaf is None else Path(SAFE, self.leaf(state), ())

    def best(self, state, layers):
        """The best path from a state; the first in the file among equals."""
        paths = self.counted([self.along(arc, layers - 1) for arc in self.arcs(state)])
        otherwise = UNKNOWN if self.unpredictable(state) else END
        return max(paths, key=lambda path: path.promise, default=otherwise)

    def counted(self, paths):
        """The paths of all actions in a state; what one risks by chance beyond the least, and no
        more than is accepted, does not count."""
        accepted = self.settings.accepted_risk
        safest = max(paths, key=lambda path: path.promise[:3], default=END)
        return [
            replace(path, danger=safest.danger, steps=safest.steps)
            if accepted > 0.0
            and path.arcs[0].rank == safest.arcs[0].rank
            and path.danger < 1.0
            and path.danger <= safest.danger + accepted
            else path
            for path in paths
        ]

    def unpredictable(self, state):
        """Whether some action has an undefined result there."""
        count = len(self.model.actions)
        flags = [self.model.transition(list(state), action)[1] for action in range(count)]
        return any(f & UNDEFINED for f in flags)

    def graph(self, root, layers):
        """The planning graph with merged states, edge by edge through networkx's own methods."""
        graph = nx.MultiDiGraph(fluents=tuple(f.name for f in self.model.fluents))

        def add(state, layer, ended):
            path = END if ended else self.best(state, layers - layer) if layer < layers else END
            graph.add_node(
                len(graph), layer=layer, state=state, ended=ended, value=path.value,
                path_risk=path.danger, safe_steps=None if path.steps == SAFE else path.steps,
            )  # fmt: skip
            return len(graph) - 1

        frontier = [add(root, 0, False)]
        for layer in range(layers):
            known = {}
            for source in frontier:
                for arc in self.arcs(graph.nodes[source]["state"]):
                    key = (arc.state, arc.ended)
                    if key not in known:
                        known[key] = add(arc.state, layer + 1, arc.ended)
                    other = (arc.written, False)
                    if arc.chance and other not in known:
                        known[other] = add(arc.written, layer + 1, False)
                    graph.add_edge(
                        source, known[key], key=arc.action, reward=arc.reward, unsafe=arc.unsafe,
                        action=self.model.actions[arc.action].name, risk=arc.risk,
                        risky=arc.rank == 1, chosen=False, chance=arc.chance,
                        written=known[other] if arc.chance else -1,
                    )  # fmt: skip
            frontier = [node for (_, ended), node in known.items() if not ended]
        node = 0
        for arc in self.best(root, layers).arcs:
            target = next(t for _, t, key in graph.out_edges(node, keys=True) if key == arc.action)
            graph.edges[node, target, arc.action]["chosen"] = True
            node = target
        return graph


def as_state(state):
    """A row of numbers as a state."""
    return tuple(state.tolist())
