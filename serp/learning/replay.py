"""The replay memory: samples of env steps, drawn in batches.

Rewards are summed over n steps before storage (n-step returns, Sutton and Barto, chapter 7).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from serp._util.saved_state import LARGEST, Saved
from serp.errors import RunError
from serp.learning.n_step import PendingStep, PendingSteps
from serp.learning.samples import Samples, SampleSpec, type_Bool
from serp.learning.sampling import Sampler
from serp.learning.symmetry_group import SymmetryGroup
from serp.settings import LearnerSettings


class ReplayBuffer:
    """A ring of samples with n-step returns, the oldest overwritten; allocated once.

    Args:
        spec: The shape of the samples.
        settings: The learner's settings.
        rng: Draws the samples; used exclusively by the buffer.
        symmetry: Every sample drawn is replaced by its image under an element of it, drawn
            uniformly; None: samples stay as they are.

    Attributes:
        size: Samples in the ring. A step becomes a sample when its n rewards are complete.
        lane: Environment, from 0, that the next steps come from.
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
        self.size = self._head = 0
        self._store = Samples.zeros(settings.buffer_size, spec)
        self._fields = self._store.arrays()
        self.lane = 0
        self._of_lane = {0: PendingSteps(settings.n_step, settings.discount)}
        self._next_forbidden: type_Bool = np.zeros(spec.action_count, np.bool_)
        shape = (settings.members, settings.batch_size)
        self._sampler = Sampler(self._store, spec, shape, rng, symmetry)

    @property
    def _pending(self) -> PendingSteps:
        """The pending steps of the current environment."""
        if self.lane not in self._of_lane:
            self._of_lane[self.lane] = PendingSteps(self._settings.n_step, self._settings.discount)
        return self._of_lane[self.lane]

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
            imitated: Action to be imitated in the state before the step; -1: none. A buffer that
                does not hold it takes -1 only.

        Raises:
            ValueError: An observation does not fit, or there is no such action.
        """
        shape, actions = (self._spec.input_size,), self._spec.action_count
        if observation.shape != shape or next_observation.shape != shape:
            raise ValueError(
                f"observations must have shape {shape}, not {observation.shape} and "
                f"{next_observation.shape}"
            )
        if not 0 <= action < actions:
            raise ValueError(f"an action must be in 0 ... {actions - 1}, not {action}")
        if not -1 <= imitated < (actions if self._spec.imitates else 0):
            raise ValueError(f"no action {imitated} can be imitated")
        pending = self._pending
        pending.push(PendingStep(np.array(observation, np.float32), action, imitated), reward)

        if next_allowed is None:
            self._next_forbidden.fill(False)
        else:
            np.logical_not(next_allowed, out=self._next_forbidden)
            if self._next_forbidden.all():
                self._next_forbidden.fill(False)

        ended = terminated or truncated
        while pending.steps and (ended or pending.complete):
            self._emit(pending, next_observation, terminated)

    def _emit(
        self, pending: PendingSteps, next_observation: npt.NDArray[np.floating], terminated: bool
    ) -> None:
        """Turn the oldest pending step into a sample."""
        row, store = self._head, self._store
        self._head = (row + 1) % self._settings.buffer_size
        self.size = min(self.size + 1, self._settings.buffer_size)
        store.discount[row] = 0.0 if terminated else pending.discount
        step = pending.steps.popleft()
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

        Raises:
            ValueError: There is no sample yet.
        """
        if not self.size:
            raise ValueError("the replay buffer has no sample yet")
        return self._sampler.draw(self.size)

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
        assert all(not lane.steps for k, lane in self._of_lane.items() if k > 0)
        arrays: dict[str, npt.NDArray[Any]] = {
            name: array[: self.size].copy() for name, array in self._fields.items()
        }
        arrays["pending.observation"], pending = self._of_lane[0].state_dict(self._spec)
        meta = {
            "shapes": self._shapes(),
            "head": self._head,
            **pending,
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
        size, head = self._saved_place(saved)
        pending = self._of_lane[0].checked(saved, self._spec)
        state = saved.generator_state("rng", self._sampler.rng)

        self.size, self._head = size, head
        for name, array in self._fields.items():
            array[:size] = arrays[name]
        self._of_lane = {0: self._of_lane[0]}
        self._of_lane[0].steps = pending
        self._sampler.rng.bit_generator.state = state

    def _check_shapes(self, saved: Saved) -> None:
        shapes = Saved("replay memory", {}, saved.part("shapes")[1])
        for name, here in self._shapes().items():
            shapes.equal(name, here, "continue with the task and the settings it was saved with")
        imitates = self._spec.imitates
        if imitates != saved.has("pending_imitated"):
            raise RunError(
                f"the saved replay memory is that of a learner {'without' if imitates else 'with'} "
                "a planner to imitate; continue with the settings it was saved with"
            )

    def _saved_place(self, saved: Saved) -> tuple[int, int]:
        """Check the samples; return their number, and the head: at the end until it is full."""
        capacity = self._settings.buffer_size
        size = len(saved.array("action", np.int64, (-1,)))
        head = saved.whole("head", 0, capacity - 1)
        if size > capacity or (size < capacity and head != size):
            raise saved.wrong(f"there are {size} samples and the head is {head}")
        for name, array in self._fields.items():
            low, high = (0.0, 1.0) if name == "discount" else (-LARGEST, LARGEST)
            if name in _LEAST_ACTION:
                low, high = _LEAST_ACTION[name], self._spec.action_count - 1
            found = saved.array(name, array.dtype, (size, *array.shape[1:]), low, high)
            if name == "forbidden" and found.all(axis=1).any():
                raise saved.wrong("forbidden forbids all actions")
        return size, head


_LEAST_ACTION = {"action": 0, "imitated": -1}
"""Fields that hold actions → the least valid value."""
