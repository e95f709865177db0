"""What the learner of an installed task learns from, as a line to print."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from serp.errors import SerpError

if TYPE_CHECKING:
    from serp.domain.loading import Domain
    from serp.task import Task


def learned_from(domain: Domain, task: Task) -> str:
    """Say what the learner of a task learns from.

    Args:
        domain: The domain file that is looked at.
        task: The task that it belongs to.
    """
    from serp.reward import said_of, source_of
    from serp.settings import resolve
    from serp.task import declared_reward

    declared = declared_reward(task, domain.model)
    source = source_of(declared, resolve("default", task.settings))
    return said_of(source, in_file=domain.model.rewarding)


def learned_from_by(domain: Domain, file: Path) -> str | None:
    """Say what the learner of the task learns from that a domain file belongs to.

    Args:
        domain: The domain.
        file: Where it was read from.

    Returns:
        A line; None where no task is installed for it.
    """
    from serp.registry import task_of

    try:
        task = task_of(domain, file)
        return None if task is None else f"task {task.name}: {learned_from(domain, task)}"
    except SerpError as error:  # the file may be right all the same
        return f"task: not loaded: {error}"
