"""A state to plan from, observed in a task's environment: one with something to choose."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from serp.model.transition_model import Vector
    from serp.planning.replanner import MonitorReplanner
    from serp.tasks.task import Task

MOST_STEPS: Final = 200
"""So many steps are made at most."""
_MOST_SECONDS: Final = 10.0


def observed(task: Task, seed: int) -> tuple[Vector, str]:
    """Return the state `[F]` after a reset of a task's environment, and where it comes from."""
    with task.bind() as bound:
        raw, _ = bound.reset(seed)
        return bound.ground(raw), f"observed after a reset with seed {seed}"


def observed_choice(task: Task, planner: MonitorReplanner, seed: int) -> tuple[Vector, str]:
    """Return the first observed state in which the planner has a choice.

    Where all actions promise the same, the planner's is carried out and the next state looked at;
    the next episode follows a finished one. Where no choice comes, the state after the reset is
    returned.

    Args:
        task: The task.
        planner: Its planner.
        seed: Seed of the reset.
    """
    deadline = time.monotonic() + _MOST_SECONDS
    with task.bind() as bound:
        raw, _ = bound.reset(seed)
        first = bound.ground(raw)
        origin = f"observed after a reset with seed {seed}"
        state, steps = first, 0
        while True:
            plan = planner.plan(state)
            if plan.forecast.applicable.sum() > 1 and not plan.indifferent:
                made = f" and {steps} step{'s' * (steps > 1)} without a choice"
                return state, origin + made * (steps > 0)
            if plan.action is None or steps == MOST_STEPS or time.monotonic() > deadline:
                return first, origin
            raw, _, terminated, truncated, _ = bound.step(
                bound.actions.environment_action[plan.action]
            )
            steps += 1
            if terminated or truncated:
                raw, _ = bound.reset()
            state = bound.ground(raw)
