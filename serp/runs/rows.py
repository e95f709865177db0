"""The rows of a run's two tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from serp.control.arbiter import Arbiter
    from serp.control.decision import Decision
    from serp.control.step_record import EpisodeTotals
    from serp.model.transition_model import Vector

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
    avoidable_unsafe: int | None
    unsafe_observed: int | None
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


def metrics_row(
    totals: EpisodeTotals,
    *,
    episode: int,
    env_steps: int,
    rho: float,
    epsilon: float | None,
    losses: Sequence[float],
    wall_time: float,
) -> MetricsRow:
    """Return the row of an episode of training."""
    return MetricsRow(
        episode=episode,
        env_steps=env_steps,
        return_=totals.return_,
        domain_return=totals.domain_return,
        length=totals.length,
        terminated=totals.terminated,
        truncated=totals.truncated,
        avoidable_unsafe=totals.avoidable_unsafe,
        unsafe_observed=totals.unsafe_observed,
        rho=rho,
        epsilon=epsilon,
        loss=float(np.mean(losses)) if losses else None,
        wall_time=wall_time,
        **totals.decisions.numbers(),
    )


def decision_row(
    decision: Decision, arbiter: Arbiter, state: Vector, *, step: int, episode: int
) -> DecisionRow:
    """Return the row of an arbiter's decision in a state `[F]`."""
    name = arbiter.actions.name
    return DecisionRow(
        step=step,
        episode=episode,
        proposed_by=decision.proposed_by,
        proposed=name(decision.proposed) if decision.proposed >= 0 else "",
        executed=name(decision.action),
        executed_by=decision.executed_by,
        reason=decision.reason,
        vetoed=decision.vetoed,
        predicted_reward=decision.predicted_reward,
        proposal_unsafe=decision.proposal_unsafe,
        unsafe=decision.unsafe,
        risk=decision.risk,
        rho=decision.rho,
        depth=decision.depth,
        bound=decision.bound,
        indifferent=decision.indifferent,
        explanation=arbiter.explain(decision, state),
    )


def _columns(row: type[NamedTuple]) -> tuple[str, ...]:
    # `return` is a keyword of Python, so the field has an underscore and the column has none.
    return tuple(field.rstrip("_") for field in row._fields)


METRICS_COLUMNS = _columns(MetricsRow)
METRICS_ADDED: Final = ("avoidable_unsafe", "unsafe_observed")
"""Columns that runs of earlier versions lack; their cells are empty."""
DECISIONS_COLUMNS = _columns(DecisionRow)
