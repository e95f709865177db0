"""n-step returns (Sutton and Barto, chapter 7): steps with fewer than n rewards so far."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from serp._util.saved_state import Saved
from serp.learning.samples import SampleSpec, type_F32


@dataclass(slots=True)
class PendingStep:
    """A step that waits for the rewards of later steps.

    `reward` is the discounted sum so far.
    """

    observation: type_F32
    action: int
    imitated: int = -1
    reward: float = 0.0


class PendingSteps:
    """The pending steps, at most `n_step`, the oldest first."""

    def __init__(self, n_step: int, discount: float) -> None:
        self._n_step = n_step
        self._powers = [discount**k for k in range(n_step + 1)]
        self.steps: deque[PendingStep] = deque()

    @property
    def complete(self) -> bool:
        """Whether the oldest step has its n rewards."""
        return len(self.steps) == self._n_step

    @property
    def discount(self) -> float:
        """Weight of the value after the rewards of the oldest step."""
        return self._powers[len(self.steps)]

    def push(self, step: PendingStep, reward: float) -> None:
        """Add a step; its reward counts for the earlier pending steps as well."""
        self.steps.append(step)
        for age, waiting in enumerate(reversed(self.steps)):
            waiting.reward += self._powers[age] * reward

    def state_dict(self, spec: SampleSpec) -> tuple[type_F32, dict[str, Any]]:
        """Return the observations ``[pending, F]``, and the rest as JSON values."""
        observations: type_F32 = np.zeros((len(self.steps), spec.input_size), np.float32)
        for row, step in zip(observations, self.steps, strict=True):
            row[:] = step.observation
        meta: dict[str, Any] = {
            "pending_action": [int(step.action) for step in self.steps],
            "pending_return": [float(step.reward) for step in self.steps],
        }
        if spec.imitates:
            meta["pending_imitated"] = [int(step.imitated) for step in self.steps]
        return observations, meta

    def checked(self, saved: Saved, spec: SampleSpec) -> deque[PendingStep]:
        """Return the steps of a state.

        Raises:
            RunError: They do not fit this learner.
        """
        most = spec.action_count - 1
        observations = saved.array("pending.observation", np.float32, (-1, spec.input_size))
        count = len(observations)
        if count >= self._n_step:  # the n-th step completes the first one
            raise saved.wrong(f"{count} steps are pending, but at most {self._n_step - 1} can be")
        columns = (
            [row.copy() for row in observations],
            saved.wholes("pending_action", count, 0, most),
            saved.wholes("pending_imitated", count, -1, most) if spec.imitates else [-1] * count,
            saved.reals("pending_return", count),
        )
        return deque(PendingStep(*entry) for entry in zip(*columns, strict=True))
