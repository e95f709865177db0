"""The replay memory: samples of env steps, drawn in batches.

Rewards are summed over n steps before storage (n-step returns, Sutton and Barto, chapter 7).
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from serp import _core
from serp._util.saved_state import LARGEST, Saved
from serp.settings import LearnerSettings

type_F32 = npt.NDArray[np.float32]
type_I64 = npt.NDArray[np.int64]


@dataclass(slots=True)
class PendingStep:
    """A step that waits for the rewards of later steps; `reward` is the discounted sum so far."""

    observation: type_F32
    action: int
    imitated: int
    reward: float = 0.0


class ReplayBuffer:
    """A ring of N samples with n-step returns, the oldest overwritten; allocated once.

    Inputs have F numbers, there are A actions; `rng` is used exclusively by the buffer.

    Attributes:
        size: Samples in the ring. A step becomes a sample when its n rewards are complete.
        samples: Field → array. `observation` float32 ``[N, F]`` before the action; `action` int64
            ``[N]``; `reward` float32 ``[N]``, the discounted sum of up to n rewards;
            `next_observation` float32 ``[N, F]`` after the last of them; `discount` float32
            ``[N]``, γᵏ for k rewards, 0 where the episode terminated; `imitated` int64 ``[N]``,
            action to be imitated in the state before the action, -1: none; `allowed` uint8
            ``[N, ⌈A / 8⌉]``, the actions that may be executed after the last reward, a bit each.
        compiled: The same memory for compiled code.
    """

    def __init__(
        self,
        input_size: int,
        action_count: int,
        settings: LearnerSettings,
        rng: np.random.Generator,
        discount: float,
    ) -> None:
        self._input_size, self._action_count = input_size, action_count
        self._settings = settings
        self.size = self._head = 0
        count = settings.buffer_size
        self.samples: dict[str, npt.NDArray[Any]] = {
            "observation": np.zeros((count, input_size), np.float32),
            "action": np.zeros(count, np.int64),
            "reward": np.zeros(count, np.float32),
            "next_observation": np.zeros((count, input_size), np.float32),
            "discount": np.zeros(count, np.float32),
            "imitated": np.zeros(count, np.int64),
            "allowed": np.zeros((count, -(-action_count // 8)), np.uint8),
        }
        self.compiled = _core.ReplaySamples(**self.samples)
        self._pending = defaultdict[int, deque[PendingStep]](deque)
        """Environment → its pending steps, at most n, the oldest first."""
        self._powers = [discount**k for k in range(settings.n_step + 1)]
        self._rng = rng

    def add(
        self,
        observation: npt.NDArray[np.floating],
        action: int,
        reward: float,
        next_observation: npt.NDArray[np.floating],
        terminated: bool,
        truncated: bool,
        imitated: int = -1,
        env_index: int = 0,
        allowed: npt.NDArray[np.bool_] | None = None,
    ) -> None:
        """Add one env step.

        Args:
            observation: ``[F]`` before the action.
            action: The executed action.
            reward: Reward of this step.
            next_observation: ``[F]`` after it; at the end of an episode its last observation, not
                the first of the next episode.
            terminated: The episode ended in a terminal state, whose value is 0.
            truncated: The episode was cut off; the value of its last state is estimated.
            imitated: Action to be imitated in the state before the step; -1: none.
            env_index: Environment, from 0, that the step comes from.
            allowed: ``[A]`` actions that are not refused after the step; None, or none True: all.
                Values of the others do not count, as they are never executed (invalid action
                masking: Huang & Ontañón, FLAIRS 2022).
        """
        if allowed is None:
            allowed = np.ones(self._action_count, np.bool_)
        bits = np.packbits(allowed, bitorder="little")
        pending = self._pending[env_index]
        pending.append(PendingStep(np.array(observation, np.float32), action, imitated))
        for age, waiting in enumerate(reversed(pending)):
            waiting.reward += self._powers[age] * reward
        ended = terminated or truncated
        samples, capacity = self.samples, self._settings.buffer_size
        while pending and (ended or len(pending) == self._settings.n_step):
            row = self._head
            self._head, self.size = (row + 1) % capacity, min(self.size + 1, capacity)
            samples["discount"][row] = 0.0 if terminated else self._powers[len(pending)]
            step = pending.popleft()
            samples["observation"][row] = step.observation
            samples["action"][row] = step.action
            samples["reward"][row] = step.reward
            samples["next_observation"][row] = next_observation
            samples["imitated"][row] = step.imitated
            samples["allowed"][row] = bits

    def draw(self, count: int) -> type_I64:
        """Draw positions of samples ``[count]``, uniformly and with replacement."""
        # Below `size`: the largest number drawn, 1 - 2⁻⁵³, times it is rounded to less.
        return (self._rng.random(count) * self.size).astype(np.int64)

    def _shapes(self) -> dict[str, int]:
        """Return the sizes that must be equal for a state to fit."""
        return {
            "observation_size": self._input_size,
            "action_count": self._action_count,
            "buffer_size": self._settings.buffer_size,
            "n_step": self._settings.n_step,
        }

    def state_dict(self) -> tuple[dict[str, npt.NDArray[Any]], dict[str, Any]]:
        """Return the complete state: arrays (rows in use only) and JSON values.

        Of several environments, all episodes must have ended.
        """
        assert not any(pending for k, pending in self._pending.items() if k > 0)
        arrays = {name: array[: self.size].copy() for name, array in self.samples.items()}
        steps = self._pending[0]
        rows = np.array([step.observation for step in steps], np.float32)
        arrays["pending.observation"] = rows.reshape(len(steps), self._input_size).copy()
        meta: dict[str, Any] = {
            "shapes": self._shapes(),
            "head": self._head,
            "pending_action": [int(step.action) for step in steps],
            "pending_return": [float(step.reward) for step in steps],
            "pending_imitated": [int(step.imitated) for step in steps],
            "rng": self._rng.bit_generator.state,
        }
        return arrays, meta

    def load_state_dict(
        self, arrays: Mapping[str, npt.NDArray[Any]], meta: Mapping[str, Any]
    ) -> None:
        """Continue from what `state_dict` returned; a RunError leaves the buffer unchanged."""
        saved = Saved("replay memory", arrays, meta)
        shapes = Saved("replay memory", {}, saved.part("shapes")[1])
        for name, here in self._shapes().items():
            shapes.equal(name, here, "continue with the original task and settings")
        size, head = self._saved_place(saved)
        pending = self._saved_pending(saved)
        state = saved.generator_state("rng", self._rng)
        self.size, self._head = size, head
        for name, array in self.samples.items():
            array[:size] = arrays[name]
        self._pending.clear()
        self._pending[0] = pending
        self._rng.bit_generator.state = state

    def _saved_pending(self, saved: Saved) -> deque[PendingStep]:
        most, last = self._settings.n_step - 1, self._action_count - 1
        observations = saved.array("pending.observation", np.float32, (-1, self._input_size))
        count = len(observations)
        if count > most:  # the n-th step completes the first one
            raise saved.wrong(f"{count} steps are pending, but at most {most} can be")
        columns = (
            [row.copy() for row in observations],
            saved.wholes("pending_action", count, 0, last),
            saved.wholes("pending_imitated", count, -1, last),
            saved.reals("pending_return", count),
        )
        return deque(PendingStep(*entry) for entry in zip(*columns, strict=True))

    def _saved_place(self, saved: Saved) -> tuple[int, int]:
        """Check the samples; return their number, and the head: at the end until it is full."""
        capacity = self._settings.buffer_size
        size = len(saved.array("action", np.int64, (-1,)))
        head = saved.whole("head", 0, capacity - 1)
        if size > capacity or (size < capacity and head != size):
            raise saved.wrong(f"head {head} contradicts {size} samples")
        last = self._action_count - 1
        bounds = {"discount": (0.0, 1.0), "action": (0, last), "imitated": (-1, last),
                  "allowed": (0, 255)}  # fmt: skip
        for name, array in self.samples.items():
            low, high = bounds.get(name, (-LARGEST, LARGEST))
            saved.array(name, array.dtype, (size, *array.shape[1:]), low, high)
        return size, head
