"""What is learned from: the reward of an observed step, by the domain or by the environment."""

from __future__ import annotations

from typing import NamedTuple

from serp.domain.model import StateError, Vector
from serp.task import BoundTask


class Judged(NamedTuple):
    """What an observed step was worth.

    Attributes:
        reward: What is learned from.
        domain_reward: R(s') of the domain file; 0 where the file has no say in the step.
        unsafe: Whether the file says of the observed step that it was unsafe.
    """

    reward: float
    domain_reward: float
    unsafe: bool


def judge(
    task: BoundTask, state: Vector, ground: int, next_state: Vector, env_reward: float
) -> Judged:
    """Judge an observed step.

    Args:
        task: Its task, which says whose reward counts.
        state: State `[F]` before the step.
        ground: Ground action that was executed; -1 where the model does not know it.
        next_state: State `[F]` after it.
        env_reward: The environment's reward.

    Raises:
        StateError: The domain's reward counts, and the file cannot judge this step.
    """
    by_domain = task.rewarded_by == "domain"
    try:
        judged = task.model.judge(state, ground, next_state)
    except StateError:
        if by_domain:
            raise
        return Judged(env_reward, 0.0, False)
    return Judged(judged.reward if by_domain else env_reward, judged.reward, judged.unsafe)
