"""Evaluation of the edges out of states, in batches: compiled, or in CPython for large domains."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED, joined
from serp.model.transition_model import TransitionModel
from serp.planning.preference import hazard, marked, rank_of
from serp.settings import PlannerSettings

State = tuple[float, ...]

_NATIVE_EDGES = 4096
_INTERPRETED_EDGES = 256
"""Edges that are evaluated between two readings of the clock: some tens of milliseconds."""


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
    if model.compiles:
        size = max(1, _NATIVE_EDGES // max(1, len(model.actions)))
        for start in range(0, len(nodes), size):
            yield _follow_native(model, settings, nodes[start : start + size], states)
        return
    for node in nodes:
        for start in range(0, len(model.actions), _INTERPRETED_EDGES):
            actions = range(start, min(start + _INTERPRETED_EDGES, len(model.actions)))
            yield _follow_interpreted(model, settings, node, actions, states[node])


def _follow_native(
    model: TransitionModel, settings: PlannerSettings, nodes: Sequence[int], states: list[State]
) -> Followed:
    from serp.model.native import address_of
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
        (address_of(model.native_step()), model.data, model.dt),
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


def _follow_interpreted(
    model: TransitionModel, settings: PlannerSettings, node: int, actions: range, state: State
) -> Followed:
    edges, reached, undefined = Edges.none(), [], False
    source = list(state)
    for action in actions:
        target, flags = model.transition(source, action)
        if not flags & APPLICABLE:
            undefined = undefined or bool(flags & UNDEFINED)
            continue
        reward = first_reward = target.pop()
        risk = hazard(flags, settings.accepted_risk)
        flags = first_flags = marked(flags, risk)
        weight = settings.discount
        periods = 0 if risk > 0.0 else 1
        for _ in range(settings.repeat - 1):
            if flags & TERMINAL:
                break
            further, again = model.transition(target, action)
            if not again & APPLICABLE:
                break
            more = hazard(again, settings.accepted_risk)
            flags = joined(flags, marked(again, more))
            risk += (1.0 - risk) * more
            periods += risk == 0.0
            reward += weight * further.pop()
            weight *= settings.discount
            target = further
        rank = rank_of(first_flags)
        edge = (node, action, reward, weight, flags, rank, periods, risk, first_reward, first_flags)
        columns: tuple[list[Any], ...] = edges
        for column, value in zip(columns, edge, strict=True):
            column.append(value)
        reached.append(tuple(target))
    return Followed(edges, reached, [node] if undefined else [])
