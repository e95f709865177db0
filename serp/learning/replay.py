"""The replay memory: samples of env steps, drawn in batches.

Rewards are summed over n steps before storage (n-step returns, Sutton and Barto, chapter 7).
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from serp import _core
from serp._util.saved_state import LARGEST, Saved
from serp.errors import RunError
from serp.settings import LearnerSettings

type_F32 = npt.NDArray[np.float32]
type_I64 = npt.NDArray[np.int64]
type_Bool = npt.NDArray[np.bool_]


class SampleSpec(NamedTuple):
    """The shape of a learner's samples: F inputs, A actions, and whether some imitate."""

    input_size: int
    action_count: int
    imitates: bool = False


@dataclass(frozen=True)
class Samples:
    """Samples, one array per field; the leading axes N are the same in all.

    The last field has no rows for a learner that does not imitate.

    Attributes:
        observation: float32 ``[*N, F]`` before the action.
        action: int64 ``[*N]``.
        reward: float32 ``[*N]``, the discounted sum of up to n rewards.
        next_observation: float32 ``[*N, F]`` after the last of them.
        discount: float32 ``[*N]``, γᵏ for k rewards; 0 where the episode terminated.
        forbidden: bool ``[*N, A]``, actions that may not be chosen next; never all.
        imitated: int64 ``[*N]``, action to be imitated in the current state; -1: none.
    """

    observation: type_F32
    action: type_I64
    reward: type_F32
    next_observation: type_F32
    discount: type_F32
    forbidden: type_Bool
    imitated: type_I64

    @staticmethod
    def zeros(lead: tuple[int, ...], spec: SampleSpec) -> Samples:
        """Allocate samples with these leading axes."""
        return Samples(
            observation=np.zeros((*lead, spec.input_size), np.float32),
            action=np.zeros(lead, np.int64),
            reward=np.zeros(lead, np.float32),
            next_observation=np.zeros((*lead, spec.input_size), np.float32),
            discount=np.zeros(lead, np.float32),
            forbidden=np.zeros((*lead, spec.action_count), np.bool_),
            imitated=np.zeros(lead if spec.imitates else 0, np.int64),
        )

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return field → array, without those that have no rows in this learner."""
        named = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: array for name, array in named.items() if array.size}

    @cached_property
    def compiled(self) -> _core.ReplaySamples:
        """The same memory for compiled code, with one leading axis."""
        lead = self.action.ndim
        arrays = (getattr(self, field.name) for field in fields(self))
        return _core.ReplaySamples(*(array.reshape(-1, *array.shape[lead:]) for array in arrays))


@dataclass(slots=True)
class PendingStep:
    """A step that waits for the rewards of later steps.

    `reward` is the discounted sum so far.
    """

    observation: type_F32
    action: int
    imitated: int = -1
    reward: float = 0.0


class ReplayBuffer:
    """A ring of samples with n-step returns, the oldest overwritten; allocated once.

    Args:
        spec: The shape of the samples.
        settings: The learner's settings.
        rng: Draws the samples; used exclusively by the buffer.
        discount: γ.

    Attributes:
        size: Samples in the ring. A step becomes a sample when its n rewards are complete.
        env_index: Environment, from 0, that the next steps come from.
    """

    def __init__(
        self,
        spec: SampleSpec,
        settings: LearnerSettings,
        rng: np.random.Generator,
        discount: float,
    ) -> None:
        self._spec = spec
        self._settings = settings
        self.size = self._head = 0
        self._store = Samples.zeros((settings.buffer_size,), spec)
        self._fields = self._store.arrays()
        self.env_index = 0
        self._pending = defaultdict[int, deque[PendingStep]](deque)
        """Environment → its pending steps, at most n, the oldest first."""
        self._powers = [discount**k for k in range(settings.n_step + 1)]
        self._next_forbidden: type_Bool = np.zeros(spec.action_count, np.bool_)
        self._rng = rng
        self._batch = Samples.zeros((settings.members, settings.batch_size), spec)
        self._uniform = np.zeros(self._batch.action.size)

    def add(
        self,
        observation: npt.NDArray[np.floating],
        action: int,
        reward: float,
        next_observation: npt.NDArray[np.floating],
        terminated: bool,
        truncated: bool,
        next_allowed: npt.NDArray[np.bool_] | None = None,
        imitated: int = -1,
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
            next_allowed: ``[A]``, which actions may be chosen next; None, or none True: all.
            imitated: Action to be imitated in the state before the step; -1: none.
        """
        pending = self._pending[self.env_index]
        pending.append(PendingStep(np.array(observation, np.float32), action, imitated))
        for age, waiting in enumerate(reversed(pending)):
            waiting.reward += self._powers[age] * reward

        if next_allowed is None:
            self._next_forbidden.fill(False)
        else:
            np.logical_not(next_allowed, out=self._next_forbidden)
            if self._next_forbidden.all():
                self._next_forbidden.fill(False)

        ended = terminated or truncated
        while pending and (ended or len(pending) == self._settings.n_step):
            self._emit(pending, next_observation, terminated)

    def _emit(
        self,
        pending: deque[PendingStep],
        next_observation: npt.NDArray[np.floating],
        terminated: bool,
    ) -> None:
        """Turn the oldest pending step into a sample."""
        row, store = self._head, self._store
        self._head = (row + 1) % self._settings.buffer_size
        self.size = min(self.size + 1, self._settings.buffer_size)
        store.discount[row] = 0.0 if terminated else self._powers[len(pending)]
        step = pending.popleft()
        store.observation[row] = step.observation
        store.action[row] = step.action
        store.reward[row] = step.reward
        store.next_observation[row] = next_observation
        store.forbidden[row] = self._next_forbidden
        if self._spec.imitates:
            store.imitated[row] = step.imitated

    def sample(self) -> Samples:
        """Draw a batch for each member, uniformly and with replacement.

        Returns:
            Samples with leading axes ``[members, batch]``, valid until the next draw.
        """
        self._rng.random(out=self._uniform)
        self._batch.compiled.draw(self._store.compiled, self.size, self._uniform)
        return self._batch

    def _shapes(self) -> dict[str, int]:
        """Return the sizes that must be equal for a state to fit."""
        return {
            "observation_size": self._spec.input_size,
            "action_count": self._spec.action_count,
            "buffer_size": self._settings.buffer_size,
            "n_step": self._settings.n_step,
        }

    def state_dict(self) -> tuple[dict[str, npt.NDArray[Any]], dict[str, Any]]:
        """Return the complete state: arrays (rows in use only) and JSON values.

        Of several environments, all episodes must have ended.
        """
        assert not any(pending for k, pending in self._pending.items() if k > 0)
        arrays: dict[str, npt.NDArray[Any]] = {
            name: array[: self.size].copy() for name, array in self._fields.items()
        }
        steps = self._pending[0]
        rows: type_F32 = np.zeros((len(steps), self._spec.input_size), np.float32)
        for row, step in zip(rows, steps, strict=True):
            row[:] = step.observation
        arrays["pending.observation"] = rows
        meta: dict[str, Any] = {
            "shapes": self._shapes(),
            "head": self._head,
            "pending_action": [int(step.action) for step in steps],
            "pending_return": [float(step.reward) for step in steps],
            "rng": self._rng.bit_generator.state,
        }
        if self._spec.imitates:
            meta["pending_imitated"] = [int(step.imitated) for step in steps]
        return arrays, meta

    def load_state_dict(
        self, arrays: Mapping[str, npt.NDArray[Any]], meta: Mapping[str, Any]
    ) -> None:
        """Continue from what `state_dict` returned.

        Raises:
            RunError: The state belongs to a buffer of other settings, or is incomplete; this
                buffer is unchanged.
        """
        saved = Saved("replay memory", arrays, meta)
        shapes = Saved("replay memory", {}, saved.part("shapes")[1])
        for name, here in self._shapes().items():
            shapes.equal(name, here, "continue with the task and the settings it was saved with")
        imitates = self._spec.imitates
        if imitates != saved.has("pending_imitated"):
            raise RunError(
                f"the saved replay memory is that of a learner {'without' if imitates else 'with'} "
                "a planner to imitate; continue with the settings it was saved with"
            )
        size, head = self._saved_place(saved)
        pending = self._saved_pending(saved)
        state = saved.generator_state("rng", self._rng)

        self.size, self._head = size, head
        for name, array in self._fields.items():
            # A saved truth value may have any bits; compiled code takes 0 and 1.
            array[:size] = arrays[name] != 0 if array.dtype == np.bool_ else arrays[name]
        self._pending.clear()
        self._pending[0] = pending
        self._rng.bit_generator.state = state

    def _saved_pending(self, saved: Saved) -> deque[PendingStep]:
        most, last = self._settings.n_step - 1, self._spec.action_count - 1
        observations = saved.array("pending.observation", np.float32, (-1, self._spec.input_size))
        count = len(observations)
        if count > most:  # the n-th step completes the first one
            raise saved.wrong(f"{count} steps are pending, but at most {most} can be")
        imitated = [-1] * count
        if self._spec.imitates:
            imitated = saved.wholes("pending_imitated", count, -1, last)
        columns = (
            [row.copy() for row in observations],
            saved.wholes("pending_action", count, 0, last), imitated,
            saved.reals("pending_return", count),
        )  # fmt: skip
        return deque(PendingStep(*entry) for entry in zip(*columns, strict=True))

    def _saved_place(self, saved: Saved) -> tuple[int, int]:
        """Check the samples; return their number, and the head: at the end until it is full."""
        capacity = self._settings.buffer_size
        size = len(saved.array("action", np.int64, (-1,)))
        head = saved.whole("head", 0, capacity - 1)
        if size > capacity or (size < capacity and head != size):
            raise saved.wrong(f"there are {size} samples and the head is {head}")
        last = self._spec.action_count - 1
        bounds = {"discount": (0.0, 1.0), "action": (0, last), "imitated": (-1, last)}
        for name, array in self._fields.items():
            low, high = bounds.get(name, (-LARGEST, LARGEST))
            rows = saved.array(name, array.dtype, (size, *array.shape[1:]), low, high)
            if name == "forbidden" and rows.all(axis=1).any():
                raise saved.wrong("forbidden forbids all actions")
        return size, head
