"""The columns of a run's two tables, as tuples with names."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

LONGEST: Final = 1 << 24
"""Bytes of a line of a table that is read."""


class MetricsRow(NamedTuple):
    """One episode: a row of ``metrics.csv``.

    Attributes:
        episode: number of the episode, from 1.
        env_steps: steps in the environment since the run began.
        return_: sum of the environment's rewards (column ``return``).
        domain_return: sum of the rewards that the domain file gives.
        length: steps of this episode.
        terminated: whether the environment ended the episode.
        truncated: whether a limit ended it.
        rho: learner probability at its end; None where there is no learner.
        epsilon: share of random choices at its end; None where there are none.
        planner_steps: steps in which the planner's action was executed, in its turn or in the
            place of a refused proposal.
        learner_steps: steps in which the learner's greedy choice was executed, or its next best
            one in the place of a refused proposal.
        exploration_steps: steps in which a random choice was executed.
        fallback_steps: steps in which neither of them had an action. The four add up to the length.
        vetoes, unsafe_predicted, unsafe_executed, no_safe_action: see
            `serp.control.decision_counts.DecisionCounts`.
        loss: mean loss of the updates in this episode; None before the first.
        wall_time: seconds of training since the run began, compilation and pauses left out.
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
    loss: float | None
    wall_time: float


class DecisionRow(NamedTuple):
    """One decision: a row of ``decisions.csv``.

    A text may be given as an enum or any object that is not changed afterwards: its text is taken
    when the table is flushed, outside of the step.

    Attributes:
        step: steps in the environment before this one since the run began.
        episode: number of the episode, from 1.
        proposed_by: planner, learner or exploration.
        proposed: the action proposed.
        executed: the action executed.
        executed_by: whose action that was: of those three, or fallback.
        reason: why this action was executed.
        vetoed: whether the proposal was refused.
        predicted_reward: reward that the model predicts for the executed action.
        proposal_unsafe: whether the domain file flags the proposed action, or it is too risky.
        unsafe: whether the domain file flags the executed action unsafe.
        risk: probability of that by the model as it was then, 0 to 1; 1 where the file flags it.
        rho: learner probability at this step.
        explanation: why the proposal was refused, in the terms of the domain file.
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
    explanation: Any


def _columns(row: type[NamedTuple]) -> tuple[str, ...]:
    # `return` is a keyword of Python, so the field has an underscore and the column has none.
    return tuple(field.rstrip("_") for field in row._fields)


METRICS_COLUMNS = _columns(MetricsRow)
DECISIONS_COLUMNS = _columns(DecisionRow)
