"""The newest transitions of a run, for estimation and for offline diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import Saved
from serp.model.transition_model import TransitionModel, Vector

GOES_ON, CUT_OFF, OVER = 0, 1, 2
"""Ending of a step: the episode goes on, is cut off (truncated), or is over (terminated)."""

_CAPACITY: Final = 20_000
_MAX_NUMBERS: Final = 8_000_000
"""Most transitions that are kept, and most numbers in their states and next states: 64 MB."""


class TransitionMemory:
    """A ring buffer of the newest transitions: state, ground action, next state, ending, reward.

    The next state of a step that ended an episode is the last state of that episode, never the
    first one of the next.

    Args:
        capacity: Transitions kept, ≥ 1.
        fluents: Width of a state, F.
        actions: Number of ground actions, A.

    Attributes:
        seen: Transitions added, including those overwritten.
    """

    def __init__(self, capacity: int, fluents: int, actions: int) -> None:
        self.seen = 0
        self._actions_known = actions
        self._capacity = capacity
        self._ring: tuple[NDArray[Any], ...] = (
            np.empty((capacity, fluents)), np.empty(capacity, np.int64),
            np.empty((capacity, fluents)), np.zeros(capacity, np.int8), np.zeros(capacity),
        )  # fmt: skip

    @classmethod
    def of(cls, model: TransitionModel) -> TransitionMemory:
        """Return an empty memory for the states and actions of a model."""
        width = len(model.fluents)
        capacity = min(_CAPACITY, max(100, _MAX_NUMBERS // max(1, 2 * width)))
        return cls(capacity, width, len(model.actions))

    def add(
        self, state: Vector, action: int, next_state: Vector, ending: int, reward: float = 0.0
    ) -> None:
        """Add one env step.

        Args:
            state: `[F]` before the action.
            action: Position of the executed ground action; −1 where the model knows none.
            next_state: `[F]` observed after it.
            ending: How the step ended: `GOES_ON`, `CUT_OFF` or `OVER`.
            reward: Reward of the step.
        """
        head = self.seen % self._capacity
        row = state, action, next_state, ending, reward
        for part, value in zip(self._ring, row, strict=True):
            part[head] = value
        self.seen += 1

    def cut_off(self) -> None:
        """Note that the newest transition was the last one of its episode."""
        endings = self._ring[3]
        newest = (self.seen - 1) % self._capacity
        endings[newest] = max(endings[newest], CUT_OFF)

    def __len__(self) -> int:
        return min(self.seen, self._capacity)

    @property
    def states(self) -> Vector:
        """`[N, F]` before the actions, the oldest first."""
        return self._in_order(0)

    @property
    def actions(self) -> NDArray[np.int64]:
        """`[N]` positions of the ground actions, −1 where the model knows none."""
        return self._in_order(1)

    @property
    def next_states(self) -> Vector:
        """`[N, F]` observed after the actions."""
        return self._in_order(2)

    @property
    def ended(self) -> NDArray[np.bool_]:
        """`[N]`, whether the episode ended with the step."""
        ended: NDArray[np.bool_] = self._in_order(3) != GOES_ON
        return ended

    @property
    def over(self) -> NDArray[np.bool_]:
        """`[N]`, whether the environment ended the task with the step."""
        over: NDArray[np.bool_] = self._in_order(3) == OVER
        return over

    @property
    def rewards(self) -> Vector:
        """`[N]` rewards of the steps."""
        return self._in_order(4)

    def _in_order(self, part: int) -> NDArray[Any]:
        """Return a copy of the rows in use, the oldest first."""
        ring, count = self._ring[part], len(self)
        head = self.seen % self._capacity if count == self._capacity else 0
        ordered: NDArray[Any] = np.concatenate((ring[head:count], ring[:head]))
        return ordered

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays (only filled rows) and JSON values that restore it exactly."""
        arrays = {name: self._in_order(part) for part, name in enumerate(self._NAMES)}
        return arrays, {"capacity": self._capacity, "seen": self.seen}

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned; a `RunError` refuses what does not fit."""
        saved, capacity = Saved("experience", arrays, meta), self._capacity
        saved.equal("capacity", capacity, "continue with the task it was saved with")
        seen = saved.whole("seen")
        count = min(seen, capacity)
        # Observed states and rewards may contain any bits.
        bounds = {"actions": (-1, self._actions_known - 1), "endings": (GOES_ON, OVER)}
        parts = [
            saved.array(name, ring.dtype, (count, *ring.shape[1:]), *bounds.get(name, (None,)))
            for name, ring in zip(self._NAMES, self._ring, strict=True)
        ]
        # The oldest row lies where the next one will be written.
        rows = (np.arange(count) + (seen if count == capacity else 0)) % capacity
        for ring, part in zip(self._ring, parts, strict=True):
            ring[rows] = part
        self.seen = seen

    _NAMES: Final = ("states", "actions", "next_states", "endings", "rewards")
