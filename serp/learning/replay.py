"""The replay memory: samples of env steps, drawn in batches.

Rewards are summed over n steps before storage (n-step returns, Sutton and Barto, chapter 7). Beside
the ring of the newest samples there is a protected memory of copies that the ring never overwrites:
the first samples, and those that led to a failure. Otherwise a learner whose guide rarely fails
would lose all samples of failures.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from serp._util.saved_state import LARGEST, Saved, whole_within
from serp.errors import RunError
from serp.learning.guidance import NO_GUIDANCE, Guidance, checked
from serp.learning.n_step import PendingStep, PendingSteps
from serp.learning.samples import Samples, SampleSpec, type_Bool
from serp.learning.sampling import Sampler
from serp.learning.symmetry_group import SymmetryGroup
from serp.settings import LearnerSettings


class _Ring:
    """A range of rows that are filled in turn, the oldest overwritten."""

    def __init__(self, start: int, capacity: int) -> None:
        self.start, self.capacity = start, capacity
        self.size = self.head = 0

    def next_row(self) -> int:
        """Return the row to write next, and count it."""
        row = self.start + self.head
        self.head = (self.head + 1) % self.capacity
        self.size = min(self.size + 1, self.capacity)
        return row


class ReplayBuffer:
    """A ring of samples, with n-step returns and a protected memory; allocated once.

    A *failure* is a step that terminates with a negative reward, or that the caller marks. The
    samples of the last `failing_window` env steps are then failing ones. A fraction
    `protected_share` of a batch is drawn from the protected memory: half of it (rounded up) from
    failing samples and half from early ones, or all from one if the other is empty.

    Args:
        spec: The shape of the samples.
        settings: The learner's settings.
        rng: Draws the samples; used exclusively by the buffer.
        symmetry: Every sample drawn is replaced by its image under an element of it, drawn
            uniformly; None: samples stay as they are.
    """

    def __init__(
        self,
        spec: SampleSpec,
        settings: LearnerSettings,
        rng: np.random.Generator,
        symmetry: SymmetryGroup | None = None,
    ) -> None:
        self._spec = spec
        self._settings = settings
        share = settings.protected_share
        self._protected_rows = max(round(share * settings.batch_size), int(share > 0.0))
        early = settings.protected_early if share > 0.0 else 0
        failing = settings.protected_failing if share > 0.0 else 0
        self._ring = _Ring(0, settings.buffer_size)
        self._early = _Ring(settings.buffer_size, early)
        self._failing = _Ring(settings.buffer_size + early, failing)
        self._memories = {"ring": self._ring, "early": self._early, "failing": self._failing}
        self._store = Samples.zeros(settings.buffer_size + early + failing, spec)
        self._fields = self._store.arrays()

        self._pending = PendingSteps(settings.n_step, settings.discount)
        self._next_forbidden: type_Bool = np.zeros(spec.action_count, np.bool_)
        # [row, is it protected?] of the last samples of the running episode.
        self._recent: deque[list[int]] = deque(maxlen=settings.failing_window)

        shape = (settings.members, settings.batch_size)
        self._sampler = Sampler(self._store, spec, shape, rng, symmetry)
        self._divided: tuple[int, ...] = ()

    @property
    def size(self) -> int:
        """Samples in the ring. A step becomes a sample when its n rewards are complete."""
        return self._ring.size

    def newest(self, count: int) -> Samples:
        """Return the newest samples of the ring, at most `count`, the oldest first."""
        head, size = self._ring.head, self._ring.size
        rows = np.arange(head - min(count, size), head) % self._ring.capacity
        return Samples._make(array[rows] if len(array) else array for array in self._store)

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
            failing: This step is a failure.
            guidance: The guide's advice on the step; required by a guided buffer.

        Raises:
            ValueError: An observation or the guidance does not fit, or there is no such action.
        """
        shape, actions = (self._spec.input_size,), self._spec.action_count
        if observation.shape != shape or next_observation.shape != shape:
            raise ValueError(
                f"observations must have shape {shape}, not {observation.shape} and "
                f"{next_observation.shape}"
            )
        if not 0 <= action < actions:
            raise ValueError(f"an action must be in 0 ... {actions - 1}, not {action}")
        guidance = checked(guidance, actions) if self._spec.guided else NO_GUIDANCE
        step = PendingStep(
            np.array(observation, np.float32), action, guidance.action, guidance.value
        )
        self._pending.push(step, reward)

        if next_allowed is None:
            self._next_forbidden.fill(False)
        else:
            np.logical_not(next_allowed, out=self._next_forbidden)
            if self._next_forbidden.all():
                self._next_forbidden.fill(False)

        ended = terminated or truncated
        while self._pending.steps and (ended or self._pending.complete):
            self._emit(next_observation, terminated, guidance)
        if self._failing.capacity and (failing or (terminated and reward < 0.0)):
            self._protect_last_steps()
        if ended:
            self._recent.clear()

    def _emit(
        self, next_observation: npt.NDArray[np.floating], terminated: bool, guidance: Guidance
    ) -> None:
        """Turn the oldest pending step into a sample."""
        row, store = self._ring.next_row(), self._store
        store.discount[row] = 0.0 if terminated else self._pending.discount
        step = self._pending.steps.popleft()
        store.observation[row] = step.observation
        store.action[row] = step.action
        store.reward[row] = step.reward
        store.next_observation[row] = next_observation
        store.forbidden[row] = self._next_forbidden
        if self._spec.guided:
            store.guide_action[row], store.guide_value[row] = step.guide_action, step.guide_value
            store.guide_next_action[row] = guidance.next_action
            store.guide_next_values[row] = guidance.next_values
        if self._early.size < self._early.capacity:
            self._copy(row, self._early)
        if self._failing.capacity:
            if step.failing:
                self._copy(row, self._failing)
            self._recent.append([row, int(step.failing)])

    def _protect_last_steps(self) -> None:
        """Protect the samples of the last steps; pending ones as soon as they are complete."""
        window, pending = self._settings.failing_window, self._pending.steps
        for step in list(pending)[-window:]:
            step.failing = True
        complete = max(window - len(pending), 0)
        for entry in list(self._recent)[max(len(self._recent) - complete, 0) :]:
            row, protected = entry
            if not protected:
                self._copy(row, self._failing)
                entry[1] = 1

    def _copy(self, source: int, ring: _Ring) -> None:
        target = ring.next_row()
        for array in self._fields.values():
            array[target] = array[source]

    def sample(self) -> Samples:
        """Draw a batch for each member, uniformly and with replacement in each memory.

        Returns:
            Samples with leading axes ``[members, batch]``, valid until the next draw.

        Raises:
            ValueError: There is no sample yet.
        """
        if not self.size:
            raise ValueError("the replay buffer has no sample yet")
        sizes = tuple(ring.size for ring in self._memories.values())
        if sizes != self._divided:
            self._sampler.divide(self._ranges())
            self._divided = sizes
        return self._sampler.draw()

    def _ranges(self) -> tuple[tuple[int, int, int], ...]:
        """Return the rows from which the columns of a batch are drawn, see `Sampler.divide`."""
        ring, early, failing = self._memories.values()
        protected = self._protected_rows if failing.size or early.size else 0
        of_failing = protected if not early.size else (protected + 1) // 2
        if not failing.size:
            of_failing = 0
        return (
            (of_failing, failing.start, failing.size),
            (protected - of_failing, early.start, early.size),
            (self._settings.batch_size - protected, ring.start, ring.size),
        )

    def _shapes(self) -> dict[str, int]:
        """Return the sizes that must be equal for a state to fit."""
        return {
            "observation_size": self._spec.input_size,
            "action_count": self._spec.action_count,
            "buffer_size": self._ring.capacity,
            "n_step": self._settings.n_step,
            "protected_early": self._early.capacity,
            "protected_failing": self._failing.capacity,
            "failing_window": self._settings.failing_window,
        }

    def state_dict(self) -> tuple[dict[str, npt.NDArray[Any]], dict[str, Any]]:
        """Return the complete state: arrays (rows in use only) and JSON values."""
        arrays: dict[str, npt.NDArray[Any]] = {
            f"{memory}.{name}": array[ring.start : ring.start + ring.size].copy()
            for memory, ring in self._memories.items()
            for name, array in self._fields.items()
        }
        arrays["pending.observation"], pending = self._pending.state_dict(self._spec)
        meta = {
            "shapes": self._shapes(),
            "sizes": [ring.size for ring in self._memories.values()],
            "heads": [ring.head for ring in self._memories.values()],
            **pending,
            "recent": [list(entry) for entry in self._recent],
            "rng": self._sampler.rng.bit_generator.state,
        }
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
        self._check_shapes(saved)
        sizes, heads = self._saved_places(saved)
        for (memory, _), size in zip(self._memories.items(), sizes, strict=True):
            self._check_arrays(saved, memory, size)
        pending = self._pending.checked(saved, self._spec)
        recent = saved.rows(
            "recent",
            self._settings.failing_window,
            lambda entry: (
                len(entry) == 2
                and whole_within(entry[0], 0, sizes[0] - 1)
                and whole_within(entry[1], 0, 1)
            ),
            "a row and whether it is protected",
        )
        state = saved.generator_state("rng", self._sampler.rng)

        for (memory, ring), size, head in zip(self._memories.items(), sizes, heads, strict=True):
            ring.size, ring.head = size, head
            for name, array in self._fields.items():
                array[ring.start : ring.start + size] = arrays[f"{memory}.{name}"]
        self._pending.steps = pending
        self._recent.clear()
        self._recent.extend(recent)
        self._sampler.rng.bit_generator.state = state
        self._divided = ()

    def _check_shapes(self, saved: Saved) -> None:
        shapes = Saved("replay memory", {}, saved.part("shapes")[1])
        for name, here in self._shapes().items():
            shapes.equal(name, here, "continue with the task and the settings it was saved with")
        guided = self._spec.guided
        if guided != saved.has("pending_guide"):
            raise RunError(
                f"the saved replay memory is that of a learner {'without' if guided else 'with'} a "
                f"guide to learn from, this learner has {'one' if guided else 'none'}; continue "
                "with the settings it was saved with"
            )

    def _saved_places(self, saved: Saved) -> tuple[list[int], list[int]]:
        """Return size and head of each memory: the head is at the end until the memory is full."""
        rings = self._memories.values()
        sizes, heads = saved.wholes("sizes", len(rings)), saved.wholes("heads", len(rings))
        for ring, size, head in zip(rings, sizes, heads, strict=True):
            full = size == ring.capacity
            if size > ring.capacity or not (head < max(size, 1) if full else head == size):
                raise saved.wrong(
                    f"sizes and heads are {sizes} and {heads}, with room for "
                    f"{[ring.capacity for ring in rings]}"
                )
        return sizes, heads

    def _check_arrays(self, saved: Saved, memory: str, size: int) -> None:
        for name, array in self._fields.items():
            low, high = (0.0, 1.0) if name == "discount" else (-LARGEST, LARGEST)
            if name in _LEAST_ACTION:
                low, high = _LEAST_ACTION[name], self._spec.action_count - 1
            shape = (size, *array.shape[1:])
            found = saved.array(f"{memory}.{name}", array.dtype, shape, low, high)
            if name == "forbidden" and found.all(axis=1).any():
                raise saved.wrong(f"{memory}.forbidden forbids all actions")


_LEAST_ACTION = {"action": 0, "guide_action": -1, "guide_next_action": -1}
"""Fields that hold actions → the least valid value."""
