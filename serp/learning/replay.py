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

from serp._util.saved_state import LARGEST, MOST, Saved, whole_within
from serp.errors import RunError
from serp.learning.guidance import NO_GUIDANCE, Guidance, checked
from serp.learning.n_step import PendingStep, PendingSteps
from serp.learning.samples import Samples, SampleSpec, type_Bool
from serp.learning.sampling import Sampler
from serp.learning.symmetry_group import SymmetryGroup
from serp.settings import LearnerSettings


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
        self._capacity = settings.buffer_size
        self._batch_size = settings.batch_size
        self._n_step = settings.n_step
        self._window = settings.failing_window
        share = settings.protected_share
        self._protected_rows = max(round(share * settings.batch_size), int(share > 0.0))
        self._early_capacity = settings.protected_early if share > 0.0 else 0
        self._failing_capacity = settings.protected_failing if share > 0.0 else 0

        # Rows: the ring, then early samples, then failing ones.
        self._early_start = self._capacity
        self._failing_start = self._capacity + self._early_capacity
        self._store = Samples.zeros(self._failing_start + self._failing_capacity, spec)
        self._fields = self._store.arrays()
        self._size = self._head = 0
        self._early_size = self._failing_size = self._failing_head = 0

        self._pending = PendingSteps(settings.n_step, settings.discount)
        self._next_forbidden: type_Bool = np.zeros(spec.action_count, np.bool_)
        # Of the running episode: its steps, and [step, row, is it copied?] of its last samples.
        self._episode_steps = 0
        self._recent: deque[list[int]] = deque(maxlen=self._window)

        shape = (settings.members, settings.batch_size)
        self._sampler = Sampler(self._store, spec, shape, rng, symmetry)
        self._dirty = True

    @property
    def size(self) -> int:
        """Samples in the ring. A step becomes a sample when its n rewards are complete."""
        return self._size

    def newest(self, count: int) -> Samples:
        """Return the newest samples of the ring, at most `count`, the oldest first."""
        rows = np.arange(self._head - min(count, self._size), self._head) % self._capacity
        return self._store.at(rows)

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
            guidance: The guide's advice on the step; required by a guided buffer, which stores the
                advice on the first and the last state of a sample; otherwise ignored.

        Raises:
            ValueError: An observation has another shape, there is no such action, or required
                guidance is absent, of another shape or not finite.
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
        self._episode_steps += 1

        if next_allowed is None:
            self._next_forbidden.fill(False)
        else:
            np.logical_not(next_allowed, out=self._next_forbidden)
            if self._next_forbidden.all():
                self._next_forbidden.fill(False)

        ended = terminated or truncated
        while self._pending and (ended or self._pending.complete):
            self._emit(next_observation, terminated, guidance)
        if self._failing_capacity and (failing or (terminated and reward < 0.0)):
            self._protect_last_steps()
        if ended:
            self._episode_steps = 0
            self._recent.clear()

    def _emit(
        self, next_observation: npt.NDArray[np.floating], terminated: bool, guidance: Guidance
    ) -> None:
        """Turn the oldest pending step into a sample."""
        row, store = self._head, self._store
        number = self._episode_steps - len(self._pending)
        discount = 0.0 if terminated else self._pending.discount
        step = self._pending.pop()
        store.observation[row] = step.observation
        store.action[row] = step.action
        store.reward[row] = step.reward
        store.next_observation[row] = next_observation
        store.discount[row] = discount
        store.forbidden[row] = self._next_forbidden
        if store.guide is not None:
            store.guide.action[row], store.guide.value[row] = step.guide_action, step.guide_value
            store.guide.next_action[row] = guidance.next_action
            store.guide.next_values[row] = guidance.next_values
        if self._early_size < self._early_capacity:
            self._copy_row(row, self._early_start + self._early_size)
            self._early_size += 1
        if self._failing_capacity:
            if step.failing:
                self._keep_failing(row)
            self._recent.append([number, row, int(step.failing)])
        self._head = (row + 1) % self._capacity
        if self._size < self._capacity:
            self._size += 1
            self._dirty = True

    def _protect_last_steps(self) -> None:
        """Protect the samples of the last steps; pending ones as soon as they are complete."""
        oldest = self._episode_steps - self._window
        for entry in self._recent:
            step, row, copied = entry
            if step >= oldest and not copied:
                self._keep_failing(row)
                entry[2] = 1
        self._pending.mark_failing(self._window)

    def _keep_failing(self, row: int) -> None:
        self._copy_row(row, self._failing_start + self._failing_head)
        self._failing_head = (self._failing_head + 1) % self._failing_capacity
        self._failing_size = min(self._failing_size + 1, self._failing_capacity)

    def _copy_row(self, source: int, target: int) -> None:
        for array in self._fields.values():
            array[target] = array[source]
        self._dirty = True

    def sample(self) -> Samples:
        """Draw a batch for each member, uniformly and with replacement in each memory.

        Returns:
            Samples with leading axes ``[members, batch]``, valid until the next draw.

        Raises:
            ValueError: There is no sample yet.
        """
        if self._size == 0:
            raise ValueError("the replay buffer has no sample yet")
        if self._dirty:
            self._sampler.divide(self._ranges())
            self._dirty = False
        return self._sampler.draw()

    def _ranges(self) -> tuple[tuple[int, int, int], ...]:
        """Return the rows from which the columns of a batch are drawn, see `Sampler.divide`."""
        protected = self._protected_rows if self._failing_size or self._early_size else 0
        failing = protected if not self._early_size else (protected + 1) // 2
        if not self._failing_size:
            failing = 0
        return (
            (failing, self._failing_start, self._failing_size),
            (protected - failing, self._early_start, self._early_size),
            (self._batch_size - protected, 0, self._size),
        )

    def _memories(self) -> tuple[tuple[str, int, int], ...]:
        """Return name, first row and number of rows in use of each memory."""
        return (
            ("ring", 0, self._size),
            ("early", self._early_start, self._early_size),
            ("failing", self._failing_start, self._failing_size),
        )

    def _shapes(self) -> dict[str, int]:
        """Return the sizes that must be equal for a state to fit."""
        return {
            "observation_size": self._spec.input_size,
            "action_count": self._spec.action_count,
            "buffer_size": self._capacity,
            "n_step": self._n_step,
            "protected_early": self._early_capacity,
            "protected_failing": self._failing_capacity,
            "failing_window": self._window,
        }

    def state_dict(self) -> tuple[dict[str, npt.NDArray[Any]], dict[str, Any]]:
        """Return the complete state: arrays (rows in use only) and JSON values."""
        arrays: dict[str, npt.NDArray[Any]] = {
            f"{memory}.{name}": array[start : start + size].copy()
            for memory, start, size in self._memories()
            for name, array in self._fields.items()
        }
        arrays["pending.observation"], pending = self._pending.state_dict(self._spec)
        meta = {
            "shapes": self._shapes(),
            "sizes": [size for _, _, size in self._memories()],
            "head": self._head,
            "failing_head": self._failing_head,
            **pending,
            "episode_steps": self._episode_steps,
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
        sizes = self._saved_sizes(saved)
        pending = self._pending.checked(saved, self._spec)
        size, _, failing_size = sizes
        head = _head(saved, "head", size, self._capacity)
        failing_head = _head(saved, "failing_head", failing_size, self._failing_capacity)
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
        for memory, start, held in self._memories():
            for name, array in self._fields.items():
                array[start : start + held] = arrays[f"{memory}.{name}"]
        self._head, self._failing_head = head, failing_head
        self._pending.restore(pending)
        self._episode_steps = episode_steps
        self._recent.clear()
        self._recent.extend(recent)
        self._sampler.rng.bit_generator.state = state
        self._dirty = True

    def _saved_sizes(self, saved: Saved) -> list[int]:
        """Check the sizes in a saved state; return the number of samples in each memory."""
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
        most = (self._capacity, self._early_capacity, self._failing_capacity)
        sizes = saved.wholes("sizes", len(most), 0, max(most))
        if any(held > room for held, room in zip(sizes, most, strict=True)):
            raise saved.wrong(f"sizes are {sizes}, but at most {list(most)}")
        for (memory, _, _), held in zip(self._memories(), sizes, strict=True):
            for name, array in self._fields.items():
                low, high = self._range_of(name)
                shape = (held, *array.shape[1:])
                found = saved.array(f"{memory}.{name}", array.dtype, shape, low, high)
                if name == "forbidden" and found.all(axis=1).any():
                    raise saved.wrong(f"{memory}.forbidden forbids all actions")
        return sizes

    def _range_of(self, field: str) -> tuple[float, float]:
        """Return the valid range of a field of samples."""
        if field in _LEAST_ACTION:
            return _LEAST_ACTION[field], self._spec.action_count - 1
        return (0.0, 1.0) if field == "discount" else (-LARGEST, LARGEST)


_LEAST_ACTION = {"action": 0, "guide_action": -1, "guide_next_action": -1}
"""Fields that hold actions → the least valid value."""


def _head(saved: Saved, name: str, size: int, capacity: int) -> int:
    """Return the position of the next row of a ring: after the last, until the ring is full."""
    if size < capacity:
        return saved.whole(name, size, size)
    return saved.whole(name, 0, max(capacity - 1, 0))
