"""An environment whose actions are proposals to an arbiter."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp.control.decision import Decision
from serp.control.protocols import Mask, Proposer
from serp.control.step_record import StepRecord
from serp.learning.dqn import Proposal
from serp.model.transition_model import Vector
from serp.tasks.bound_task import BoundTask
from serp.training.agent import Agent
from serp.training.environments.task_env import TaskEnv
from serp.training.rollout import Rollout


class _Asked:
    """Stands for a learner whose action is not known yet; notes whether it was asked for one."""

    def __init__(self) -> None:
        self.asked = False

    def propose(self, explorable: Mask | None) -> Proposal:
        """Propose any action."""
        return self.propose_greedily()

    def propose_greedily(self) -> Proposal:
        """Propose any action."""
        self.asked = True
        return Proposal(0, False, None)


class _Turn(NamedTuple):
    """Whose turn it is in a state.

    Attributes:
        decision: The decision if the learner's action does not count.
        asked: Whether the strategy wants the learner's action.
        masks: `[E]` actions that will be executed if they are proposed.
    """

    decision: Decision
    asked: bool
    masks: NDArray[np.bool_]


class ArbitratedEnv(TaskEnv):
    """A task whose actions are proposals: planner, strategy and vetoes decide what is executed.

    The strategy is asked before the action is known, and an action counts only if it is the
    learner's turn. So a strategy that looks at the learner's values cannot be used.

    Args:
        task: The task.
        agent: Planner, strategy and arbiter.
        seed: Seed of the first sequence of episodes; `reset(seed=s)` begins that of s.
        derive: (seed, number of the episode from 0) → seed of the task's environment.
    """

    def __init__(
        self, task: BoundTask, agent: Agent, seed: int, derive: Callable[[int, int], int]
    ) -> None:
        super().__init__(task, agent)
        self._seed, self._begun = seed, 0
        self._derive = derive
        self._turn: _Turn | None = None
        self._last: tuple[Decision, Vector] | None = None

    @abstractmethod
    def ask(self, state: Vector, learner: Proposer) -> Decision:
        """Return the decision in a state for a learner."""

    def action_masks(self) -> NDArray[np.bool_]:
        """Return `[E]` actions that will be executed if they are proposed in the current state.

        On the learner's turn these are the actions that no veto refuses. On the planner's turn, or
        if all are refused, it is the one action that is executed whatever is proposed. A learner
        that draws from the masked actions, like MaskablePPO, therefore always learns from what it
        has chosen itself.

        Raises:
            gymnasium.error.ResetNeeded: No episode is running.
        """
        return self._whose_turn(self.running).masks.copy()

    @property
    def last_decision(self) -> Decision | None:
        """The decision of the last step; None before the first one."""
        return None if self._last is None else self._last[0]

    def explain(self) -> str:
        """Return why the last step refused its proposal, quoting the domain file; empty if not."""
        return "" if self._last is None else self._agent.arbiter.explain(*self._last)

    def decide(self, rollout: Rollout, action: int) -> Decision:
        """Return the decision for a proposal."""
        turn = self._whose_turn(rollout)
        decision, self._turn = turn.decision, None
        if turn.asked:
            proposal = Proposal(action, False, None)
            decision = self._agent.arbiter.exchange(decision, proposal)
        self._last = decision, rollout.state
        return decision

    def _whose_turn(self, rollout: Rollout) -> _Turn:
        if self._turn is None:
            learner = _Asked()
            decision = self.ask(rollout.state, learner)
            masks = decision.admissible
            if not (learner.asked and masks.any()):
                masks = np.arange(len(masks)) == decision.action
            self._turn = _Turn(decision, learner.asked, masks)
        return self._turn

    def next_seed(self, seed: int | None) -> int:
        """Begin an episode of the sequence, or of another one; return its seed."""
        self._turn = None
        if seed is not None:
            self._seed, self._begun = seed, 0
        self._begun += 1
        return self._derive(self._seed, self._begun - 1)

    def after_step(self, step: StepRecord) -> dict[str, Any]:
        """Return the task's info with what was executed, by whom and why."""
        decision = step.decision
        return {
            **step.info,
            "executed_action": decision.action,
            "executed_by": str(decision.executed_by),
            "reason": str(decision.reason),
        }
