"""The replay memory: what was experienced, ready to be drawn in batches.

Rewards are summed over n steps on the way in (n-step returns, Sutton and Barto, chapter 7). Beside
the ring of the newest samples there is a protected memory of copies that the ring never overwrites:
the first samples, and those that led to a failure. A learner whose guide rarely fails otherwise
forgets what a failure is.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from serp.errors import RunError
from serp.learning import kernels
from serp.learning.symmetry import SymmetryGroup

type_F32 = npt.NDArray[np.float32]
type_I64 = npt.NDArray[np.int64]
type_Bool = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Samples:
    """Samples side by side, one array a field; the leading axes N are the same in all.

    Attributes:
        observation: float32 ``[*N, F]`` before the action.
        action: int64 ``[*N]``.
        reward: float32 ``[*N]``, the discounted sum of up to n rewards.
        next_observation: float32 ``[*N, F]`` after the last of them.
        discount: float32 ``[*N]``, γᵏ for k rewards; 0 where the episode terminated.
        forbidden: bool ``[*N, A]``, actions that may not be chosen next; never all.
    """

    observation: type_F32
    action: type_I64
    reward: type_F32
    next_observation: type_F32
    discount: type_F32
    forbidden: type_Bool

    @staticmethod
    def zeros(count: int, observation_size: int, action_count: int) -> Samples:
        """Room for `count` samples."""
        return Samples(
            observation=np.zeros((count, observation_size), np.float32),
            action=np.zeros(count, np.int64),
            reward=np.zeros(count, np.float32),
            next_observation=np.zeros((count, observation_size), np.float32),
            discount=np.zeros(count, np.float32),
            forbidden=np.zeros((count, action_count), np.bool_),
        )

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Field → array."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def reshaped(self, *lead: int) -> Samples:
        """Views with the one leading axis split into several."""
        return Samples(**{k: a.reshape(*lead, *a.shape[1:]) for k, a in self.arrays().items()})


class ReplayBuffer:
    """A ring of samples, with n-step returns and a protected memory. Allocated once.

    Args:
        observation_size: numbers in an observation, F.
        action_count: A.
        capacity: samples in the ring, ≥ 1.
        batch_size: samples a draw (a member), ≥ 1.
        members: batches a draw, ≥ 1.
        n_step: rewards summed, ≥ 1.
        discount: γ.
        protected_share: share of a batch from the protected memory, 0 to 1: half of it (rounded
            up) from failing samples and half from early ones, all from one where the other is
            empty. 0 keeps no protected memory.
        protected_early: the first so many samples are kept.
        protected_failing: so many failing samples are kept.
        failing_window: a failure makes the samples of so many last env steps failing ones;
            at most `capacity`.
        rng: draws the samples; from now on the buffer's own.
        symmetry: every sample drawn is replaced by its image under an element of it, drawn
            uniformly; None: samples stay as they are.

    A *failure* is a step that terminates with a negative reward, or that the caller says is one.
    """

    def __init__(
        self,
        observation_size: int,
        action_count: int,
        *,
        capacity: int,
        batch_size: int,
        members: int = 1,
        n_step: int = 1,
        discount: float = 0.99,
        protected_share: float = 0.0,
        protected_early: int = 0,
        protected_failing: int = 0,
        failing_window: int = 1,
        rng: np.random.Generator,
        symmetry: SymmetryGroup | None = None,
    ) -> None:
        if failing_window > capacity:
            raise ValueError(f"failing_window {failing_window} exceeds the capacity {capacity}")
        self._capacity = capacity
        self._n_step = n_step
        self._powers = [discount**k for k in range(n_step + 1)]
        self._window = failing_window
        self._protected_rows = round(protected_share * batch_size)
        if protected_share > 0.0:
            self._protected_rows = max(self._protected_rows, 1)
        self._early_capacity = protected_early if protected_share > 0.0 else 0
        self._failing_capacity = protected_failing if protected_share > 0.0 else 0
        self._rng = rng
        self._symmetry = symmetry

        # Rows: the ring, then early samples, then failing ones.
        self._early_start = capacity
        self._failing_start = capacity + self._early_capacity
        rows = self._failing_start + self._failing_capacity
        self._shape = (observation_size,)
        self._action_count = action_count
        self._store = Samples.zeros(rows, observation_size, action_count)
        self._fields = self._store.arrays()
        self._size = self._head = 0
        self._early_size = 0
        self._failing_size = self._failing_head = 0

        # The window of steps whose n rewards are not complete; `_first` is the oldest slot.
        self._pending_observation: type_F32 = np.zeros((n_step, observation_size), np.float32)
        self._pending_action = [0] * n_step
        self._pending_return = [0.0] * n_step
        self._pending_failing = [False] * n_step
        self._first = self._pending = 0
        self._next_forbidden: type_Bool = np.zeros(action_count, np.bool_)
        # Of the running episode: its steps, and [step, row, is it copied?] of its last samples.
        self._episode_steps = 0
        self._recent: deque[list[int]] = deque(maxlen=failing_window)

        self._uniform = np.zeros((members, batch_size))
        self._rows: type_I64 = np.zeros((members, batch_size), np.int64)
        self._flat_rows = self._rows.reshape(-1)
        self._counts = np.zeros(batch_size)
        self._starts: type_I64 = np.zeros(batch_size, np.int64)
        self._flat = Samples.zeros(members * batch_size, observation_size, action_count)
        self._batch = self._flat.reshaped(members, batch_size)
        self._dirty = True

    @property
    def size(self) -> int:
        """Samples in the ring. A step becomes a sample when its n rewards are complete."""
        return self._size

    @property
    def protected_sizes(self) -> tuple[int, int]:
        """Samples in the protected memory: early, failing."""
        return self._early_size, self._failing_size

    def add(
        self,
        observation: npt.NDArray[np.floating],
        action: int,
        reward: float,
        next_observation: npt.NDArray[np.floating],
        terminated: bool,
        truncated: bool,
        next_allowed: npt.NDArray[np.bool_] | None = None,
        failing: bool = False,
    ) -> None:
        """Takes one env step.

        Args:
            observation: ``[F]`` before the action.
            action: the executed action.
            reward: of this step.
            next_observation: ``[F]`` after it; at the end of an episode the last one, not the
                first of the next episode.
            terminated: the episode ended in a terminal state: nothing follows.
            truncated: the episode was cut off: what would follow is estimated.
            next_allowed: ``[A]``, which actions may be chosen next; None, or none True: all.
            failing: this step is a failure.

        Raises:
            ValueError: an observation has another shape, or there is no such action.
        """
        if observation.shape != self._shape or next_observation.shape != self._shape:
            raise ValueError(
                f"observations must have shape {self._shape}, not {observation.shape} and "
                f"{next_observation.shape}"
            )
        if not 0 <= action < self._action_count:
            raise ValueError(f"there are {self._action_count} actions, none is {action}")
        n = self._n_step
        slot = (self._first + self._pending) % n
        self._pending_observation[slot] = observation
        self._pending_action[slot] = action
        self._pending_return[slot] = 0.0
        self._pending_failing[slot] = False
        self._pending += 1
        self._episode_steps += 1
        for age in range(self._pending):
            self._pending_return[(slot - age) % n] += self._powers[age] * reward

        if next_allowed is None:
            self._next_forbidden.fill(False)
        else:
            np.logical_not(next_allowed, out=self._next_forbidden)
            if self._next_forbidden.all():
                self._next_forbidden.fill(False)

        if terminated or truncated:
            while self._pending:
                self._emit(next_observation, terminated)
        elif self._pending == n:
            self._emit(next_observation, False)

        if self._failing_capacity and (failing or (terminated and reward < 0.0)):
            self._protect_last_steps()
        if terminated or truncated:
            self._episode_steps = 0
            self._recent.clear()

    def _emit(self, next_observation: npt.NDArray[np.floating], terminated: bool) -> None:
        """Makes a sample of the oldest pending step."""
        slot, row, store = self._first, self._head, self._store
        store.observation[row] = self._pending_observation[slot]
        store.action[row] = self._pending_action[slot]
        store.reward[row] = self._pending_return[slot]
        store.next_observation[row] = next_observation
        store.discount[row] = 0.0 if terminated else self._powers[self._pending]
        store.forbidden[row] = self._next_forbidden
        if self._early_size < self._early_capacity:
            self._copy_row(row, self._early_start + self._early_size)
            self._early_size += 1
        if self._failing_capacity:
            copied = self._pending_failing[slot]
            if copied:
                self._keep_failing(row)
            self._recent.append([self._episode_steps - self._pending, row, int(copied)])
        self._first = (slot + 1) % self._n_step
        self._pending -= 1
        self._head = (row + 1) % self._capacity
        if self._size < self._capacity:
            self._size += 1
            self._dirty = True

    def _protect_last_steps(self) -> None:
        """Keeps the samples of the last steps, now or, while they are pending, when complete."""
        oldest = self._episode_steps - self._window
        for entry in self._recent:
            step, row, copied = entry
            if step >= oldest and not copied:
                self._keep_failing(row)
                entry[2] = 1
        for age in range(self._pending):
            if self._episode_steps - 1 - age >= oldest:
                slot = (self._first + self._pending - 1 - age) % self._n_step
                self._pending_failing[slot] = True

    def _keep_failing(self, row: int) -> None:
        self._copy_row(row, self._failing_start + self._failing_head)
        self._failing_head = (self._failing_head + 1) % self._failing_capacity
        self._failing_size = min(self._failing_size + 1, self._failing_capacity)
        self._dirty = True

    def _copy_row(self, source: int, target: int) -> None:
        for array in self._fields.values():
            array[target] = array[source]
        self._dirty = True

    def sample(self) -> Samples:
        """Draws a batch for each member, uniformly and with replacement in each memory.

        Returns:
            Samples with leading axes ``[members, batch]``, valid until the next draw.

        Raises:
            ValueError: there is no sample yet.
        """
        if self._size == 0:
            raise ValueError("the replay buffer has no sample yet")
        if self._dirty:
            self._divide_batch()
        rows = self._rows
        self._rng.random(out=self._uniform)
        np.multiply(self._uniform, self._counts, out=self._uniform)
        np.copyto(rows, self._uniform, casting="unsafe")  # rounds down
        np.add(rows, self._starts, out=rows)
        # Every row exists; mode "clip" only spares take a copy of its output.
        flat, store, out = self._flat_rows, self._store, self._flat
        store.reward.take(flat, out=out.reward, mode="clip")
        store.discount.take(flat, out=out.discount, mode="clip")
        if self._symmetry is not None:
            self._take_images(self._symmetry)
            return self._batch
        store.observation.take(flat, axis=0, out=out.observation, mode="clip")
        store.action.take(flat, out=out.action, mode="clip")
        store.next_observation.take(flat, axis=0, out=out.next_observation, mode="clip")
        store.forbidden.take(flat, axis=0, out=out.forbidden, mode="clip")
        return self._batch

    def _take_images(self, symmetry: SymmetryGroup) -> None:
        self._rng.random(out=self._uniform)
        elements = (self._uniform.reshape(-1) * len(symmetry)).astype(np.int64)  # rounds down
        store, out = self._store, self._flat
        kernels.take_images(
            self._flat_rows, elements, symmetry.columns, symmetry.signs, symmetry.actions,
            store.observation, store.action, store.next_observation, store.forbidden,
            out.observation, out.action, out.next_observation, out.forbidden,
        )  # fmt: skip

    def _divide_batch(self) -> None:
        """Which rows of memory each column of a batch is drawn from."""
        protected = self._protected_rows
        if not self._failing_size and not self._early_size:
            failing = protected = 0
        elif not self._failing_size:
            failing = 0
        elif not self._early_size:
            failing = protected
        else:
            failing = (protected + 1) // 2
        self._counts[:failing] = self._failing_size
        self._starts[:failing] = self._failing_start
        self._counts[failing:protected] = self._early_size
        self._starts[failing:protected] = self._early_start
        self._counts[protected:] = self._size
        self._starts[protected:] = 0
        self._dirty = False

    def _memories(self) -> tuple[tuple[str, int, int], ...]:
        """Name, first row and rows in use of each memory."""
        return (
            ("ring", 0, self._size),
            ("early", self._early_start, self._early_size),
            ("failing", self._failing_start, self._failing_size),
        )

    def _shapes(self) -> dict[str, int]:
        """What must be equal for a state to fit."""
        return {
            "observation_size": self._shape[0],
            "action_count": self._action_count,
            "buffer_size": self._capacity,
            "n_step": self._n_step,
            "protected_early": self._early_capacity,
            "protected_failing": self._failing_capacity,
            "failing_window": self._window,
        }

    def state_dict(self) -> tuple[dict[str, npt.NDArray[Any]], dict[str, Any]]:
        """Everything the future depends on: arrays (only rows in use) and plain JSON values."""
        arrays = {
            f"{memory}.{name}": array[start : start + size].copy()
            for memory, start, size in self._memories()
            for name, array in self._fields.items()
        }
        order = [(self._first + i) % self._n_step for i in range(self._pending)]
        arrays["pending.observation"] = self._pending_observation[order]
        meta = {
            "shapes": self._shapes(),
            "sizes": [size for _, _, size in self._memories()],
            "head": self._head,
            "failing_head": self._failing_head,
            "pending_action": [int(self._pending_action[i]) for i in order],
            "pending_return": [float(self._pending_return[i]) for i in order],
            "pending_failing": [self._pending_failing[i] for i in order],
            "episode_steps": self._episode_steps,
            "recent": [list(entry) for entry in self._recent],
            "rng": self._rng.bit_generator.state,
        }
        return arrays, meta

    def load_state_dict(
        self, arrays: Mapping[str, npt.NDArray[Any]], meta: Mapping[str, Any]
    ) -> None:
        """Continues from what `state_dict` returned.

        Raises:
            RunError: the state belongs to a buffer of other settings, or is incomplete; this
                buffer is unchanged.
        """
        for name, here in self._shapes().items():
            saved = meta["shapes"].get(name)
            if saved != here:
                raise RunError(
                    f"the saved replay memory has {name} {saved}, this learner {here}; continue "
                    "with the task and the settings it was saved with"
                )
        sizes = [int(size) for size in meta["sizes"]]
        pending = len(meta["pending_action"])
        lengths = {
            f"{memory}.{name}": size
            for (memory, _, _), size in zip(self._memories(), sizes, strict=True)
            for name in self._fields
        } | {"pending.observation": pending}
        for name, length in lengths.items():
            if name not in arrays or len(arrays[name]) != length:
                raise RunError(f"the saved replay memory is incomplete: {name}")
            if name.endswith(".action") and not _all_within(arrays[name], self._action_count):
                raise RunError(f"the saved replay memory has actions that do not exist: {name}")

        self._size, self._early_size, self._failing_size = sizes
        for memory, start, size in self._memories():
            for name, array in self._fields.items():
                array[start : start + size] = arrays[f"{memory}.{name}"]
        self._head = int(meta["head"])
        self._failing_head = int(meta["failing_head"])
        self._first, self._pending = 0, pending
        self._pending_observation[:pending] = arrays["pending.observation"]
        self._pending_action[:pending] = map(int, meta["pending_action"])
        self._pending_return[:pending] = map(float, meta["pending_return"])
        self._pending_failing[:pending] = map(bool, meta["pending_failing"])
        self._episode_steps = int(meta["episode_steps"])
        self._recent.clear()
        self._recent.extend([int(value) for value in entry] for entry in meta["recent"])
        self._rng.bit_generator.state = meta["rng"]
        self._dirty = True


def _all_within(actions: npt.NDArray[Any], count: int) -> bool:
    return bool(((actions >= 0) & (actions < count)).all())
