"""How far and how hard the planner looks."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from serp.errors import SettingsError

MAX_EDGES = 4_000_000


class Bound(IntEnum):
    """What ended the expansion of the planning graph."""

    DEPTH = 0
    NODES = 1
    TIME = 2
    EXHAUSTED = 3


@dataclass(frozen=True, kw_only=True)
class PlannerSettings:
    """Settings of the monitor-replanning planner.

    Attributes:
        depth: Lookahead in actions, at least 1.
        discount: Weight of a reward one control period later, in (0, 1].
        repeat: Control periods that one edge of the graph stands for; the executed action is
            still reconsidered in every period.
        max_nodes: Most nodes that are expanded. A layer that would exceed it is not expanded;
            the deepest complete layer counts. The first layer always does.
    """

    depth: int = 5
    discount: float = 0.99
    repeat: int = 1
    max_nodes: int = 10_000

    def __post_init__(self) -> None:
        for name in ("depth", "repeat", "max_nodes"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise SettingsError(f"planner: {name} must be a whole number >= 1, not {value!r}")
        if not (isinstance(self.discount, int | float) and 0 < self.discount <= 1):
            raise SettingsError(f"planner: discount must be in (0, 1], not {self.discount!r}")

    def node_budget(self, actions: int) -> int:
        """Return the most nodes to expand where each has `actions` edges.

        Memory stays bounded (at most 4 million edges) whatever the domain.
        """
        return max(1, min(self.max_nodes, MAX_EDGES // max(1, actions)))
