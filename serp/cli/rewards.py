"""What the learner of a task learns from, as a line to print."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from serp.model.loading import Domain
    from serp.tasks.task import Task


def learned_from(domain: Domain, task: Task) -> str:
    """Say what the learner of a task learns from.

    Args:
        domain: The domain file that is looked at.
        task: The task that it belongs to.

    Raises:
        SettingsError: The settings of the task are wrong.
    """
    from serp.settings import resolve
    from serp.tasks.reward import describe_source, reward_source
    from serp.tasks.task import declared_reward

    declared = declared_reward(task, domain.model)
    source = reward_source(declared, resolve("default", task.settings))
    said = describe_source(source, in_file=domain.model.rewarding)
    return f"task {task.name or domain.name}: the learner learns from {said}"
