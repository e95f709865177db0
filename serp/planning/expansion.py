"""Evaluation of the edges out of states, in batches."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from serp.model.flags import APPLICABLE, UNDEFINED
from serp.model.transition_model import TransitionModel
from serp.settings import PlannerSettings

State = tuple[float, ...]

_EDGES = 4096
"""Edges that are evaluated between two readings of the clock."""


class Followed(NamedTuple):
    """Applicable edges, the states that they lead to, and nodes with an undefined result."""

    edges: Edges
    reached: list[State]
    undefined: list[int]


class Edges(NamedTuple):
    """Applicable edges as columns, in the order of their sources and actions.

    Columns instead of objects, because a decision creates thousands of edges.

    Attributes:
        source: Node that the edge leaves.
        action: Position of its action.
        reward: Discounted sum of the rewards of its control periods.
        weight: Weight of the rewards after it.
        flags: Flags of the whole edge.
        rank: `serp.planning.preference.rank_of` its first control period.
        periods: Its control periods; those before the first with a risk, if any has one.
        risk: Probability that it is unsafe, without the steps whose risk is accepted.
        first_reward, first_flags: Reward and flags of its first period.
    """

    source: list[int]
    action: list[int]
    reward: list[float]
    weight: list[float]
    flags: list[int]
    rank: list[int]
    periods: list[int]
    risk: list[float]
    first_reward: list[float]
    first_flags: list[int]

    @classmethod
    def none(cls) -> Edges:
        """Return no edges."""
        return cls([], [], [], [], [], [], [], [], [], [])

    def extend(self, other: Edges) -> None:
        """Append other edges."""
        columns: tuple[list[Any], ...] = self
        others: tuple[list[Any], ...] = other
        for column, more in zip(columns, others, strict=True):
            column.extend(more)


def follow(
    model: TransitionModel, settings: PlannerSettings, nodes: Sequence[int], states: list[State]
) -> Iterator[Followed]:
    """Follow every edge out of some nodes, given by their positions in `states`, in batches."""
    size = max(1, _EDGES // max(1, len(model.actions)))
    for start in range(0, len(nodes), size):
        yield _follow(model, settings, nodes[start : start + size], states)


def _follow(
    model: TransitionModel, settings: PlannerSettings, nodes: Sequence[int], states: list[State]
) -> Followed:
    from serp.planning.edge_kernels import expand
    from serp.planning.kernel_records import Rules

    actions, width = len(model.actions), len(model.fluents)
    tried = len(nodes) * actions
    rows = np.zeros((len(nodes), width + 1))
    rows[:, :width] = [states[node] for node in nodes]
    out = np.empty((tried + 1, width + 1))
    reward, weight, risk, first_reward = np.empty((4, tried))
    flags, rank, periods, first_flags = np.empty((4, tried), dtype=np.int64)
    columns = (reward, weight, flags, rank, periods, risk, first_reward, first_flags)
    expand(
        model.machine_code,
        tuple(Rules(actions, 1, settings.repeat, settings.discount, settings.accepted_risk)),
        len(nodes), rows.reshape(-1), out.reshape(-1),
        columns,
    )  # fmt: skip
    there = np.flatnonzero(flags & APPLICABLE)
    edges = Edges(
        np.asarray(nodes)[there // actions].tolist(),
        (there % actions).tolist(),
        *(column[there].tolist() for column in columns),
    )
    undefined = np.flatnonzero((flags & UNDEFINED).reshape(len(nodes), actions).any(axis=1))
    return Followed(
        edges, list(map(tuple, out[there, :width].tolist())), np.asarray(nodes)[undefined].tolist()
    )
