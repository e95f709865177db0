"""How far and how hard the planner looks."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

from serp._util.numbers import real, whole
from serp.errors import SettingsError

MAX_EDGES = 4_000_000
"""Most edges that are tried."""
MAX_PERIODS = 10_000
"""Largest depth, and most repetitions: what is farther away is no plan."""
MAX_NUMBERS = 10_000_000
"""Most numbers in the states that the edges of a graph lead to."""


LEAF_VALUES = ("never", "indifferent", "always")


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
        depth: Lookahead in actions, 1 to 10,000.
        discount: Weight of a reward one control period later, in (0, 1].
        repeat: Control periods that one edge of the graph stands for, 1 to 10,000; the executed
            action is still reconsidered in every period.
        max_nodes: Most nodes that are expanded. A layer that would exceed it is not expanded;
            the deepest complete layer counts. The first layer always does. Domains with very many
            actions or fluents meet `node_budget` or `edge_budget` before.
        accepted_risk: Largest predicted probability of something unsafe, in [0, 1), that an action
            may have and still pass for safe. A model that does not correct itself predicts none.
        leaf_value: When the states that the last layer leads to are worth what the learner sees in
            them, once that has proven right (see `serp.control.leaf_value_bootstrap`); else they
            are worth nothing. `never`; `indifferent`: where all actions promise the same
            otherwise; `always`. For agents under the strategy `mixture` whose learner sees the
            state.
    """

    depth: int = 5
    discount: float = 0.99
    repeat: int = 1
    max_nodes: int = 10_000
    accepted_risk: float = 0.02
    leaf_value: Literal["never", "indifferent", "always"] = "never"

    def __post_init__(self) -> None:
        for name in ("depth", "repeat", "max_nodes"):
            value = getattr(self, name)
            number = whole(value, 1)
            if number is None:
                raise SettingsError(f"planner: {name} must be a whole number >= 1, not {value!r}")
            object.__setattr__(self, name, number)
        if not isinstance(self.leaf_value, str) or self.leaf_value not in LEAF_VALUES:
            raise SettingsError(
                f"planner: leaf_value must be {' or '.join(LEAF_VALUES)}, not {self.leaf_value!r}"
            )
        discount = real(self.discount)
        if discount is None or not 0 < discount <= 1:
            raise SettingsError(f"planner: discount must be in (0, 1], not {self.discount!r}")
        object.__setattr__(self, "discount", float(discount))
        accepted = real(self.accepted_risk)
        if accepted is None or not 0 <= accepted < 1:
            raise SettingsError(
                f"planner: accepted_risk must be in [0, 1), not {self.accepted_risk!r}"
            )
        object.__setattr__(self, "accepted_risk", accepted)
        for name in ("depth", "repeat"):
            if getattr(self, name) > MAX_PERIODS:
                raise SettingsError(
                    f"planner: {name} must be at most {MAX_PERIODS:,}, not {getattr(self, name):,}"
                )

    def node_budget(self, actions: int) -> int:
        """Return the most nodes to expand where `actions` edges are tried at each."""
        return max(1, min(self.max_nodes, MAX_EDGES // max(1, actions)))

    def edge_budget(self, fluents: int) -> int:
        """Return the most edges that a graph holds where a state has `fluents` numbers.

        It bounds the memory: a layer that would exceed it is dropped, as by `max_nodes`.
        """
        return MAX_NUMBERS // (fluents + 1)
