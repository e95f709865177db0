"""The columns of a run's two tables, as tuples with names."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

LONGEST: Final = 1 << 24
"""Bytes of a line of a table that is read."""


class MetricsRow(NamedTuple):
    """One episode: a row of ``metrics.csv``.

    Attributes:
        episode: Number of the episode, from 1.
        env_steps: Steps in the environment since the run began.
        return_: Sum of the environment's rewards (column ``return``).
        domain_return: Sum of the rewards that the domain file gives.
        length: Steps of this episode.
        terminated: Whether the environment ended the episode.
        truncated: Whether a limit ended it.
        rho: Learner probability at its end; None where there is no learner.
        epsilon: Share of random choices at its end; None where there are none.
        planner_steps: Steps in which the planner's action was executed, in its turn or in the
            place of a refused proposal.
        learner_steps: Steps in which the learner's greedy choice was executed, or its next best
            one in the place of a refused proposal.
        exploration_steps: Steps in which a random choice was executed.
        fallback_steps: Steps in which neither of them had an action. The four add up to the length.
        vetoes, unsafe_predicted, unsafe_executed, no_safe_action: See
            `serp.control.decision_counts.DecisionCounts`.
        loss: Mean loss of the updates in this episode; None before the first.
        wall_time: Seconds of training since the run began, compilation and pauses left out.
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
        step: Steps in the environment before this one since the run began.
        episode: Number of the episode, from 1.
        proposed_by: Planner, learner or exploration.
        proposed: The action proposed.
        executed: The action executed.
        executed_by: Whose action that was: of those three, or fallback.
        reason: Why this action was executed.
        vetoed: Whether the proposal was refused.
        predicted_reward: Reward that the model predicts for the executed action.
        proposal_unsafe: Whether the domain file flags the proposed action, or it is too risky.
        unsafe: Whether the domain file flags the executed action unsafe.
        risk: Probability of that by the model as it was then, 0 to 1; 1 where the file flags it.
        rho: Learner probability at this step.
        explanation: Why the proposal was refused, in the terms of the domain file.
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
