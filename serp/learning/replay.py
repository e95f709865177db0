"""The replay memory: what was experienced, ready to be drawn in batches.

Rewards are summed over n steps on the way in (n-step returns, Sutton and Barto, chapter 7). Beside
the ring of the newest samples there is a protected memory of copies that the ring never overwrites:
the first samples, and those that led to a failure. A learner whose guide rarely fails otherwise
forgets what a failure is.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from serp._util.saved_state import LARGEST, MOST, Saved, whole_within
from serp.errors import RunError
from serp.learning.guidance import Guidance
from serp.learning.samples import Samples, type_Bool, type_F32
from serp.learning.sampling import Sampler
from serp.learning.symmetry_group import SymmetryGroup


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
        guided: what a guide said is kept with every sample.

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
        guided: bool = False,
    ) -> None:
        if failing_window > capacity:
            raise ValueError(f"failing_window {failing_window} exceeds the capacity {capacity}")
        self._capacity = capacity
        self._batch_size = batch_size
        self._n_step = n_step
        self._powers = [discount**k for k in range(n_step + 1)]
        self._window = failing_window
        self._protected_rows = round(protected_share * batch_size)
        if protected_share > 0.0:
            self._protected_rows = max(self._protected_rows, 1)
        self._early_capacity = protected_early if protected_share > 0.0 else 0
        self._failing_capacity = protected_failing if protected_share > 0.0 else 0

        # Rows: the ring, then early samples, then failing ones.
        self._early_start = capacity
        self._failing_start = capacity + self._early_capacity
        rows = self._failing_start + self._failing_capacity
        self._shape = (observation_size,)
        self._action_count = action_count
        self._store = Samples.zeros(rows, observation_size, action_count, guided=guided)
        self._fields = self._store.arrays()
        self._size = self._head = 0
        self._early_size = 0
        self._failing_size = self._failing_head = 0

        # The window of steps whose n rewards are not complete; `_first` is the oldest slot.
        self._pending_observation: type_F32 = np.zeros((n_step, observation_size), np.float32)
        self._pending_action = [0] * n_step
        self._pending_return = [0.0] * n_step
        self._pending_failing = [False] * n_step
        # What the guide said about their own states; about the next state it is `_guidance`'s.
        self._pending_guide: list[tuple[int, float]] = [(-1, 0.0)] * n_step
        self._guidance: Guidance | None = None
        self._first = self._pending = 0
        self._next_forbidden: type_Bool = np.zeros(action_count, np.bool_)
        # Of the running episode: its steps, and [step, row, is it copied?] of its last samples.
        self._episode_steps = 0
        self._recent: deque[list[int]] = deque(maxlen=failing_window)

        self._sampler = Sampler(self._store, members, batch_size, rng, symmetry)
        self._dirty = True

    @property
    def size(self) -> int:
        """Samples in the ring. A step becomes a sample when its n rewards are complete."""
        return self._size

    def newest(self, count: int) -> Samples:
        """The newest samples of the ring, at most `count`, the oldest first."""
        rows = np.arange(self._head - min(count, self._size), self._head) % self._capacity
        return self._store.at(rows)

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
        guidance: Guidance | None = None,
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
            guidance: what the guide said about the step; needed by a guided buffer, which keeps
                what it said about the first state of a sample and about the last. Others leave it.

        Raises:
            ValueError: an observation has another shape, there is no such action, or guidance is
                needed and absent, of another shape or not finite.
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
        if self._store.guide is not None:
            self._guidance = self._checked(guidance)
            self._pending_guide[slot] = self._guidance.action, self._guidance.value
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

    def _checked(self, guidance: Guidance | None) -> Guidance:
        if guidance is None:
            raise ValueError("a learner that learns from a guide needs its guidance for every step")
        actions = self._action_count
        for action in (guidance.action, guidance.next_action):
            if not -1 <= action < actions:
                raise ValueError(f"there are {actions} actions, a guide cannot choose {action}")
        values = guidance.next_values
        if values.shape != (actions,):
            raise ValueError(f"a guide's values must have shape ({actions},), not {values.shape}")
        if not (math.isfinite(guidance.value) and np.isfinite(values).all()):
            raise ValueError(f"a guide's values must be finite, not {guidance.value} and {values}")
        return guidance

    def _emit(self, next_observation: npt.NDArray[np.floating], terminated: bool) -> None:
        """Makes a sample of the oldest pending step."""
        slot, row, store = self._first, self._head, self._store
        store.observation[row] = self._pending_observation[slot]
        store.action[row] = self._pending_action[slot]
        store.reward[row] = self._pending_return[slot]
        store.next_observation[row] = next_observation
        store.discount[row] = 0.0 if terminated else self._powers[self._pending]
        store.forbidden[row] = self._next_forbidden
        if store.guide is not None and self._guidance is not None:
            store.guide.action[row], store.guide.value[row] = self._pending_guide[slot]
            store.guide.next_action[row] = self._guidance.next_action
            store.guide.next_values[row] = self._guidance.next_values
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
            self._sampler.divide(self._ranges())
            self._dirty = False
        return self._sampler.draw()

    def _ranges(self) -> tuple[tuple[int, int, int], ...]:
        """Which rows the columns of a batch are drawn from, see `Sampler.divide`."""
        protected = self._protected_rows
        if not self._failing_size and not self._early_size:
            failing = protected = 0
        elif not self._failing_size:
            failing = 0
        elif not self._early_size:
            failing = protected
        else:
            failing = (protected + 1) // 2
        return (
            (failing, self._failing_start, self._failing_size),
            (protected - failing, self._early_start, self._early_size),
            (self._batch_size - protected, 0, self._size),
        )

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
            "rng": self._sampler.rng.bit_generator.state,
        }
        if self._store.guide is not None:
            meta["pending_guide"] = [int(self._pending_guide[i][0]) for i in order]
            meta["pending_value"] = [float(self._pending_guide[i][1]) for i in order]
        return arrays, meta

    def load_state_dict(
        self, arrays: Mapping[str, npt.NDArray[Any]], meta: Mapping[str, Any]
    ) -> None:
        """Continues from what `state_dict` returned.

        Raises:
            RunError: the state belongs to a buffer of other settings, or is incomplete; this
                buffer is unchanged.
        """
        saved = Saved("replay memory", arrays, meta)
        shapes = Saved("replay memory", {}, saved.part("shapes")[1])
        for name, here in self._shapes().items():
            shapes.equal(name, here, "continue with the task and the settings it was saved with")
        guided = self._store.guide is not None
        if guided != saved.has("pending_guide"):
            raise RunError(
                f"the saved replay memory is that of a learner {'without' if guided else 'with'} a "
                f"guide to learn from, this learner has {'one' if guided else 'none'}; continue "
                "with the settings it was saved with"
            )
        most = (self._capacity, self._early_capacity, self._failing_capacity)
        sizes = saved.wholes("sizes", len(most), 0, max(most))
        size, _, failing_size = sizes
        if any(held > room for held, room in zip(sizes, most, strict=True)):
            raise saved.wrong(f"sizes are {sizes}, and there is room for {list(most)}")
        for (memory, _, _), held in zip(self._memories(), sizes, strict=True):
            for name, array in self._fields.items():
                low, high = self._range_of(name)
                saved.array(f"{memory}.{name}", array.dtype, (held, *array.shape[1:]), low, high)
            if arrays[f"{memory}.forbidden"].all(axis=1).any():
                raise saved.wrong(f"{memory}.forbidden forbids everything")
        head = _head(saved, "head", size, self._capacity)
        failing_head = _head(saved, "failing_head", failing_size, self._failing_capacity)
        actions = self._action_count
        # The n-th step completes the first one.
        width = len(self._pending_observation[0])
        observations = saved.array("pending.observation", np.float32, (-1, width))
        pending = len(observations)
        if pending >= self._n_step:
            raise saved.wrong(f"{pending} steps wait for {self._n_step} rewards")
        pending_action = saved.wholes("pending_action", pending, 0, actions - 1)
        pending_return = saved.reals("pending_return", pending)
        pending_failing = saved.truths("pending_failing", pending)
        guide: list[tuple[int, float]] = []
        if guided:
            chosen = saved.wholes("pending_guide", pending, -1, actions - 1)
            guide = list(zip(chosen, saved.reals("pending_value", pending), strict=True))
        recent = saved.rows(
            "recent",
            self._window,
            lambda entry: (
                len(entry) == 3
                and whole_within(entry[0], 0, MOST)
                and whole_within(entry[1], 0, size - 1)
                and whole_within(entry[2], 0, 1)
            ),
            "a step, its row and whether it was copied",
        )
        episode_steps = saved.whole("episode_steps")
        state = saved.generator_state("rng", self._sampler.rng)

        self._size, self._early_size, self._failing_size = sizes
        for memory, start, size in self._memories():
            for name, array in self._fields.items():
                array[start : start + size] = arrays[f"{memory}.{name}"]
        self._head, self._failing_head = head, failing_head
        self._first, self._pending = 0, pending
        self._pending_observation[:pending] = observations
        self._pending_action[:pending] = pending_action
        self._pending_return[:pending] = pending_return
        self._pending_failing[:pending] = pending_failing
        if guided:
            self._pending_guide[:pending] = guide
        self._episode_steps = episode_steps
        self._recent.clear()
        self._recent.extend(recent)
        self._sampler.rng.bit_generator.state = state
        self._dirty = True

    def _range_of(self, field: str) -> tuple[float, float]:
        """Between which values a field of samples lies."""
        if field in _LEAST_ACTION:
            return _LEAST_ACTION[field], self._action_count - 1
        return (0.0, 1.0) if field == "discount" else (-LARGEST, LARGEST)


_LEAST_ACTION = {"action": 0, "guide_action": -1, "guide_next_action": -1}
"""Fields that hold actions → the least that they may hold."""


def _head(saved: Saved, name: str, size: int, capacity: int) -> int:
    """Where the next row of a ring goes: behind the last one, until the ring is full."""
    if size < capacity:
        return saved.whole(name, size, size)
    return saved.whole(name, 0, max(capacity - 1, 0))
