"""The rows of a run's two tables."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

LONGEST: Final = 1 << 24
"""Largest length of a line that is read, in bytes."""


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
        rho: Learner probability at its end; None without a learner.
        epsilon: Probability of a random choice at its end; None if there are none.
        planner_steps: Steps in which the planner's action was executed, in its turn or in place of
            a refused proposal.
        learner_steps: Steps in which the learner's greedy choice was executed, or its next best
            one in place of a refused proposal.
        exploration_steps: Steps in which a random choice was executed.
        fallback_steps: Steps in which neither planner nor learner had an action. The four numbers
            add up to the length.
        vetoes, unsafe_predicted, unsafe_executed, no_safe_action: See
            `serp.control.decision_counts.DecisionCounts`.
        loss: Mean loss of the updates in this episode; None if there were none.
        wall_time: Seconds of training since the run began, without compilation and pauses.
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

    A text may be an enum or any immutable object; it is converted to a string when the table is
    flushed, not during the step.

    Attributes:
        step: Steps in the environment before this one since the run began.
        episode: Number of the episode, from 1.
        proposed_by: Planner, learner or exploration.
        proposed: The action proposed.
        executed: The action executed.
        executed_by: Whose action it was: planner, learner, exploration or fallback.
        reason: Why this action was executed.
        vetoed: Whether the proposal was refused.
        predicted_reward: Reward that the model predicts for the executed action.
        proposal_unsafe: Whether the domain file flags the proposed action, or it is too risky.
        unsafe: Whether the domain file flags the executed action unsafe.
        risk: Probability, 0 to 1, that it is unsafe by the model at that time; 1 if it is flagged.
        rho: Learner probability at this step.
        explanation: Why the proposal was refused, in terms of the domain file.
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
