"""The environment in which an external algorithm is trained."""

from __future__ import annotations

from typing import Any

from serp.control.decision import Decision
from serp.control.step_record import OnStep, StepRecord
from serp.learning.dqn import Proposal
from serp.tasks.bound_task import BoundTask
from serp.training.agent import Agent
from serp.training.environments.task_env import TaskEnv
from serp.training.rollout import Rollout, training_seed


class ExternalEnv(TaskEnv):
    """A task as a Gymnasium environment, with the protocol of serp's own learner.

    Episodes begin with the same seeds as in serp's training, whatever is given to `reset`. Nothing
    is refused; the agent forecasts steps to count unsafe ones.

    Attributes:
        on_step: Called with every env step.
    """

    def __init__(
        self, task: BoundTask, agent: Agent, seed: int, on_step: OnStep | None = None
    ) -> None:
        super().__init__(task, agent)
        self.on_step = on_step
        self._seed = seed
        self._episode = 0

    def next_seed(self, seed: int | None) -> int:
        """Return the seed of the next episode of serp's training."""
        self._episode += 1
        return training_seed(self._seed, self._episode - 1)

    def decide(self, rollout: Rollout, action: int) -> Decision:
        """Execute the action, whatever it is."""
        return self._agent.guarded.execute(rollout.state, Proposal(action, False, None))

    def after_step(self, step: StepRecord) -> dict[str, Any]:
        """Report the step; the info is the task's."""
        if self.on_step is not None:
            self.on_step(step)
        return step.info
