"""The rows of a run's two tables."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

LONGEST: Final = 1 << 24
"""Largest length of a line that is read, in bytes."""


class MetricsRow(NamedTuple):
    """One episode: a row of ``metrics.csv``, whose columns docs/reference/run-folder.md explains.

    None is an empty cell.
    """

    episode: int
    env_steps: int
    return_: float
    domain_return: float | None
    length: int
    terminated: bool
    truncated: bool
    rho: float | None
    epsilon: float | None
    planner_steps: int
    learner_steps: int
    exploration_steps: int
    fallback_steps: int
    vetoes: int
    unsafe_predicted: int
    unsafe_executed: int
    no_safe_action: int
    saw_all: int
    by_cells: int
    cut_short: int
    layers_seen: int
    indifferent: int
    loss: float | None
    wall_time: float


class DecisionRow(NamedTuple):
    """One decision: a row of ``decisions.csv``, explained in the same place.

    A text may be an enum or any immutable object; it is converted to a string when the table is
    flushed, not during the step.
    """

    step: int
    episode: int
    proposed_by: Any
    proposed: Any
    executed: Any
    executed_by: Any
    reason: Any
    vetoed: bool
    predicted_reward: float | None
    proposal_unsafe: bool
    unsafe: bool
    risk: float | None
    rho: float | None
    depth: int
    bound: Any
    indifferent: bool
    explanation: Any


def _columns(row: type[NamedTuple]) -> tuple[str, ...]:
    # `return` is a keyword of Python, so the field has an underscore and the column has none.
    return tuple(field.rstrip("_") for field in row._fields)


METRICS_COLUMNS = _columns(MetricsRow)
DECISIONS_COLUMNS = _columns(DecisionRow)
