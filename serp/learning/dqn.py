"""The learner of the paper (section 3.3): a DQN, with later improvements.

One env step of a training loop::

    proposal = learner.propose(observation)
    ...                                     # the arbiter decides, the environment steps
    learner.remember(observation, executed, reward, next_observation, terminated, truncated)
    loss = learner.learn()

See `serp.learning.gradient_updates` about determinism.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from serp._util.numbers import FLOAT32_MAX, best_of
from serp._util.saved_state import LARGEST, Saved, nested
from serp.errors import LearningFailure, RunError
from serp.learning.gradient_updates import QLearning
from serp.learning.replay import ReplayBuffer
from serp.settings import LearnerSettings


class Proposal(NamedTuple):
    """The action that the learner proposes, by its index, and whether it was drawn at random."""

    action: int
    exploratory: bool


class DQN:
    """Deep Q-network (Mnih et al. 2015) on one CPU core.

    Args:
        input_size: Numbers in one input, F ≥ 1.
        action_count: Actions, A ≥ 1.
        settings: The learner's settings.
        seed: Equal seeds give bitwise equal results. A `SeedSequence` is not changed.
        imitates: Whether it imitates the planner; it then explores little from the beginning.
        discount: γ, weight of the reward of the next step.

    Attributes:
        env_index: Environment, from 0, that the next env steps to remember come from.
        env_steps: Number of env steps remembered.
        imitation_weight: Current weight of imitation, ≥ 0, at first 0; it is not saved.
    """

    def __init__(
        self,
        input_size: int,
        action_count: int,
        settings: LearnerSettings,
        seed: np.random.SeedSequence | int,
        imitates: bool = False,
        discount: float = 0.99,
    ) -> None:
        self.imitates, self._discount, self.settings = imitates, discount, settings
        self.imitation_weight = 0.0
        self.input_size, self.action_count = input_size, action_count
        start_rng, sample_rng, self._explore_rng = _generators(seed)
        self.learning = QLearning(input_size, action_count, settings, start_rng)
        self.replay = ReplayBuffer(input_size, action_count, settings, sample_rng, discount)
        self.env_steps = self.env_index = self._learn_calls = 0

    @property
    def updates(self) -> int:
        """Number of gradient updates, including those of `pretrain`."""
        return self.learning.steps

    @property
    def epsilon(self) -> float:
        """Probability that the next proposal explores: linear in the env steps, then constant."""
        settings = self.settings
        if self.env_steps >= settings.epsilon_steps:
            return settings.epsilon_end
        start, done = 0.1 if self.imitates else 1.0, self.env_steps / settings.epsilon_steps
        return start + (settings.epsilon_end - start) * done

    def propose(
        self, x: npt.NDArray[np.floating], explorable: npt.NDArray[np.bool_] | None = None
    ) -> Proposal:
        """Choose an action ε-greedily.

        With probability `epsilon` it is drawn uniformly from the explorable actions; else it is the
        action with the largest Q (the lowest index in a tie), explorable or not.

        Args:
            x: One input ``[F]``.
            explorable: ``[A]``; None, or none True: all.
        """
        rng = self._explore_rng
        if rng.random() >= self.epsilon:
            return self.propose_greedily(x)
        actions = np.arange(self.action_count)
        if explorable is not None and explorable.any():
            actions = np.flatnonzero(explorable)
        return Proposal(int(actions[rng.integers(len(actions))]), True)

    def propose_greedily(self, x: npt.NDArray[np.floating]) -> Proposal:
        """Choose the action with the largest Q for one input ``[F]``; draw nothing at random."""
        if x.ndim != 1:
            raise ValueError(f"an input must have shape ({self.input_size},), not {x.shape}")
        return Proposal(best_of(self.learning.online.q(x)), False)

    def values(self, x: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
        """Return the Q-values of each network of the ensemble ``[M, A]`` for one input ``[F]``."""
        return self.learning.online.values(np.ascontiguousarray(x, np.float32))

    def remember(
        self,
        observation: npt.NDArray[np.floating],
        action: int,
        reward: float,
        next_observation: npt.NDArray[np.floating],
        terminated: bool,
        truncated: bool,
        imitated: int = -1,
        allowed: npt.NDArray[np.bool_] | None = None,
    ) -> None:
        """Store one env step with the *executed* action; see `ReplayBuffer.add`.

        Raises:
            LearningFailure: The return of such rewards may exceed float32.
        """
        reward = float(reward)
        largest = abs(reward) / (1.0 - self._discount)
        if not largest <= FLOAT32_MAX:
            raise LearningFailure(
                f"learner: rewards such as {reward:g} add up to a return of {largest:g}, more "
                f"than float32 holds (up to {FLOAT32_MAX:.2g}). Give smaller rewards."
            )
        if self.settings.target_polyak is None:
            allowed = None  # the paper's equation 3
        self.replay.add(
            observation, action, reward, next_observation, terminated, truncated, imitated,
            self.env_index, allowed,
        )  # fmt: skip
        self.env_steps += 1

    def learn(self) -> float | None:
        """Do the gradient updates due for one env step; return their mean loss, None for none.

        Raises:
            LearningFailure: The loss is not finite.
        """
        if self.env_steps < self.settings.learning_starts or not self.replay.size:
            return None
        # Computed from whole counts, so that a ratio such as 0.1 never drifts.
        done = int(self._learn_calls * self.settings.updates_per_step)
        self._learn_calls += 1
        return self.pretrain(int(self._learn_calls * self.settings.updates_per_step) - done)

    def pretrain(self, updates: int) -> float | None:
        """Do gradient updates on the samples so far (Algorithm 1, line 1); see `learn`."""
        if updates <= 0 or not self.replay.size:
            return None
        given = self.replay, self.imitation_weight, self.env_steps
        return sum(self.learning.learn(*given) for _ in range(updates)) / updates

    def state_dict(self) -> tuple[dict[str, npt.NDArray[Any]], dict[str, Any]]:
        """Return the complete state: arrays and plain JSON values.

        Raises:
            LearningFailure: A parameter is not finite.
        """
        if self.learning.not_finite() is not None:
            why = "a number that is to be saved is not finite"
            raise self.learning.failure(why, self.env_steps)
        replay, replay_meta = self.replay.state_dict()
        arrays = {name: array.copy() for name, array in self.learning.arrays().items()}
        arrays |= nested("replay", replay)
        meta = {
            "env_steps": self.env_steps,
            "learn_calls": self._learn_calls,
            "updates": self.updates,
            "explore_rng": self._explore_rng.bit_generator.state,
            "replay": replay_meta,
        }
        return arrays, meta

    def load_state_dict(
        self, arrays: Mapping[str, npt.NDArray[Any]], meta: Mapping[str, Any]
    ) -> None:
        """Continue, bit for bit, from what `state_dict` returned; a RunError changes nothing."""
        saved, learning = Saved("learner", arrays, meta), self.learning
        trained = learning.arrays()
        for name, array in trained.items():
            low = 0.0 if name == "adam_second" else -LARGEST
            saved.array(name, np.float32, array.shape, low)
        if saved.has("target") and "target" not in trained:
            raise RunError(
                "the saved learner has a target network, but the new settings have none; continue "
                "with the original settings"
            )
        env_steps, learn_calls = saved.whole("env_steps"), saved.whole("learn_calls")
        updates = saved.whole("updates")
        state = saved.generator_state("explore_rng", self._explore_rng)
        self.replay.load_state_dict(*saved.part("replay"))
        for name, array in trained.items():
            array[...] = arrays[name]
        self.env_steps, self._learn_calls, learning.steps = env_steps, learn_calls, updates
        self._explore_rng.bit_generator.state = state


def _generators(seed: np.random.SeedSequence | int) -> list[np.random.Generator]:
    """Return independent generators for initial weights, sampling and exploration."""
    sequence = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    # spawn() would change the caller's sequence, and another call would give other children.
    own = np.random.SeedSequence([int(word) for word in sequence.generate_state(4)])
    return [np.random.default_rng(child) for child in own.spawn(3)]
