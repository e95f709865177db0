"""ε-greedy exploration."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from serp.settings import LearnerSettings


class EpsilonGreedy:
    """Decides between a random action and the greedy one.

    Args:
        settings: The learner's settings.
        action_count: A.
        rng: Random generator, used exclusively by this object.

    Attributes:
        rng: As above.
    """

    def __init__(
        self, settings: LearnerSettings, action_count: int, rng: np.random.Generator
    ) -> None:
        self._start, self._end = settings.epsilon_start, settings.epsilon_end
        self._steps = settings.epsilon_steps
        self._action_count = action_count
        self.rng = rng

    def epsilon(self, env_step: int) -> float:
        """Return the probability of exploring: linear from start to end, then constant."""
        if env_step >= self._steps:
            return self._end
        return self._start + (self._end - self._start) * (env_step / self._steps)

    def draw(self, env_step: int, explorable: npt.NDArray[np.bool_] | None) -> int | None:
        """Return an explorable action, uniformly, with probability `epsilon`; else None.

        Args:
            env_step: Env steps done, ≥ 0.
            explorable: ``[A]``; None, or none True: all.
        """
        if self.rng.random() >= self.epsilon(env_step):
            return None
        if explorable is not None:
            candidates = np.flatnonzero(explorable)
            if len(candidates):
                return int(candidates[self.rng.integers(len(candidates))])
        return int(self.rng.integers(self._action_count))
