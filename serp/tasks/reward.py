"""The reward that the learner learns from: of the domain file, of the environment, or their sum.

The planner always uses the rewards of the domain file. The learner uses those that the task
declares (`Task.reward`), unless the setting `training.reward` says otherwise.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple

from serp.errors import SettingsError
from serp.model.transition_model import StateError, Vector

if TYPE_CHECKING:
    from serp.settings import Settings
    from serp.tasks.bound_task import BoundTask

Source = Literal["domain", "environment", "sum"]


class Judged(NamedTuple):
    """The rewards and the safety of an observed step; see `serp.StepRecord`."""

    reward: float
    domain_reward: float
    unsafe: bool


class Judge:
    """Judges the observed steps of a task; the setting `training.reward` chooses the reward.

    Args:
        task: The task.
        settings: All settings; None where nothing is learned from the steps: the reward is then the
            environment's.

    Raises:
        SettingsError: The domain's rewards are to be learned from, but it gives none.
    """

    def __init__(self, task: BoundTask, settings: Settings | None = None) -> None:
        self.source: Source = "environment"
        if settings is not None:
            self.source = reward_source(task.rewarded_by, settings)
        self._model = task.model
        if self.source != "environment" and not task.model.rewarding:
            raise SettingsError(
                f"training: reward is {self.source}, but the domain of task {task.name} says "
                "nothing about reward; let an action or event `(increase (reward) ...)`, or set "
                "training.reward=environment"
            )

    def __call__(self, state: Vector, ground: int, next_state: Vector, env_reward: float) -> Judged:
        """Judge an observed step by a ground action, -1 if the model does not know it.

        Raises:
            StateError: The domain's reward is learned from, and the file cannot judge this step.
        """
        try:
            judged = self._model.judge(state, ground, next_state)
        except StateError:
            if self.source != "environment":
                raise
            return Judged(env_reward, 0.0, False)
        if self.source == "environment":
            reward = env_reward
        elif self.source == "domain":
            reward = judged.reward
        else:
            reward = judged.reward + env_reward
        return Judged(reward, judged.reward, judged.unsafe)


def reward_source(declared: Literal["domain", "environment"], settings: Settings) -> Source:
    """Return the source of the reward that is learned from, given the one that a task declares."""
    choice = settings.training.reward
    return declared if choice == "task" else choice


def describe_source(source: Source, *, in_file: bool, world: bool = False) -> str:
    """Return the end of a sentence that begins with "the learner learns from".

    `in_file` says whether the domain file gives rewards, `world` whether it is the environment.
    """
    if world and source == "environment" and in_file:
        return "the rewards of the domain file, for what really happened"
    match source:
        case "domain":
            return "the rewards of the domain file"
        case "sum":
            return "the environment's reward plus those of the domain file"
    if not in_file:
        return "the environment's reward; the domain file gives none"
    return (
        "the environment's reward; the planner plans with those of the domain file "
        "(training.reward=sum or domain: the learner learns from these, too)"
    )
