"""A strategy, a planner and a learner that serp finds by their entry points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

import serp


class PlannerFirst(serp.Strategy):
    """The planner acts until the learner begins to learn.

    Args:
        settings: All settings.
        seed: Seed of its draws; it draws nothing.
    """

    def __init__(self, settings: serp.Settings, seed: Any) -> None:
        super().__init__(settings, seed)
        self._left = settings.learner.learning_starts

    def propose(self, situation: Any, learner: Any) -> Any:
        """Return the learner's proposal, or None where it is the planner's turn."""
        if self._left:
            self._left -= 1
            return None
        return learner.propose(situation.admissible)

    def state_dict(self) -> dict[str, Any]:
        """Return what a checkpoint keeps."""
        return {"left": self._left}

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned."""
        self._left = int(meta["left"])


def one_step(model: serp.TransitionModel, settings: Any) -> serp.Lookahead:
    """Return a planner that looks one action ahead, whatever the settings say."""
    return serp.Lookahead(model, settings.replace(depth=1))


class Table:
    """Q-learning in a table (Watkins 1989), whose cells are inputs rounded to one decimal.

    Args:
        input_size: Numbers in an input, F.
        action_count: Number of actions, A.
        settings: The learner's settings; it uses those of ε.
        seed: Seed of its exploration.
        imitates: Whether steps come with an action to imitate; it does not imitate.
        discount: Weight of the reward of the next step.
    """

    def __init__(
        self,
        input_size: int,
        action_count: int,
        settings: Any,
        seed: Any,
        imitates: bool = False,
        discount: float = 0.99,
    ) -> None:
        self.input_size, self.action_count, self.settings = input_size, action_count, settings
        self.imitates, self._discount = imitates, discount
        self.imitation_weight, self.env_index, self.updates = 0.0, 0, 0
        self._q: dict[tuple[float, ...], Any] = {}
        self._random = np.random.default_rng(seed)
        self._error: float | None = None

    def _values(self, x: Any) -> Any:
        """Return the Q-values `[A]` of an input; a new cell begins with 0."""
        return self._q.setdefault(tuple(np.round(x, 1).tolist()), np.zeros(self.action_count))

    @property
    def epsilon(self) -> float:
        """The probability that the next proposal explores."""
        end, steps = self.settings.epsilon_end, self.settings.epsilon_steps
        return 1.0 + (end - 1.0) * min(1.0, self.updates / max(1, steps))

    def propose(self, x: Any, explorable: Any = None) -> serp.Proposal:
        """Propose the best action, or with probability ε any explorable one."""
        if self._random.random() >= self.epsilon:
            return self.propose_greedily(x)
        actions = np.arange(self.action_count)
        if explorable is not None and explorable.any():
            actions = np.flatnonzero(explorable)
        return serp.Proposal(int(self._random.choice(actions)), True)

    def propose_greedily(self, x: Any) -> serp.Proposal:
        """Propose the best action."""
        return serp.Proposal(int(self._values(x).argmax()), False)

    def remember(
        self, x: Any, action: int, reward: float, next_x: Any, terminated: bool, truncated: bool,
        imitated: int = -1, allowed: Any = None,
    ) -> None:  # fmt: skip
        """Learn from a step at once; a state that ended the episode is worth 0."""
        target = reward
        if not terminated:
            values = self._values(next_x)
            possible = values if allowed is None or not allowed.any() else values[allowed]
            target += self._discount * possible.max()
        self._error = float(target - self._values(x)[action])
        self._values(x)[action] += 0.2 * self._error
        self.updates += 1

    def learn(self) -> float | None:
        """Return the squared error of the last step."""
        return None if self._error is None else self._error**2

    def pretrain(self, updates: int) -> None:
        """Do nothing more with the initial data."""

    def state_dict(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return what a checkpoint keeps: arrays and JSON values."""
        cells = np.array([*self._q], dtype=np.float64).reshape(-1, self.input_size)
        values = np.array([*self._q.values()]).reshape(-1, self.action_count)
        random = self._random.bit_generator.state
        return {"cells": cells, "values": values}, {"updates": self.updates, "random": random}

    def load_state_dict(self, arrays: Mapping[str, Any], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned."""
        cells, values = arrays["cells"], arrays["values"]
        if cells.shape[1:] != (self.input_size,) or values.shape != (len(cells), self.action_count):
            raise serp.RunError("the saved table belongs to another task")
        self._q = {tuple(c.tolist()): v.copy() for c, v in zip(cells, values, strict=True)}
        self.updates, self._error = int(meta["updates"]), None
        self._random.bit_generator.state = meta["random"]
