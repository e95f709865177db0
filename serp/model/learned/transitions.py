"""The newest transitions of a run, for estimation and for offline diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import Saved
from serp.model.transition_model import TransitionModel, Vector

_CAPACITY: Final = 20_000
_MAX_NUMBERS: Final = 8_000_000
"""Most transitions, and most numbers in their states and next states: 64 MB."""


class TransitionMemory:
    """A ring buffer of the newest transitions: state, ground action, next state, end, reward.

    The next state of a step that ended an episode is the last state of that episode, never the
    first one of the next. `seen` counts the transitions added, including those overwritten.
    """

    def __init__(self, capacity: int, fluents: int, actions: int) -> None:
        self.seen = 0
        self._known_actions = actions
        self._capacity = capacity
        self._ring: dict[str, NDArray[Any]] = {
            "states": np.empty((capacity, fluents)),
            "actions": np.empty(capacity, np.int64),
            "next_states": np.empty((capacity, fluents)),
            "over": np.zeros(capacity, np.bool_),
            "rewards": np.zeros(capacity),
        }

    @classmethod
    def of(cls, model: TransitionModel) -> TransitionMemory:
        """Return an empty memory for the states and actions of a model."""
        width = len(model.fluents)
        capacity = min(_CAPACITY, max(100, _MAX_NUMBERS // max(1, 2 * width)))
        return cls(capacity, width, len(model.actions))

    def add(
        self, state: Vector, action: int, next_state: Vector, over: bool, reward: float = 0.0
    ) -> None:
        """Add an env step: states `[F]`, the executed ground action, −1 where none is known."""
        row = state, action, next_state, over, reward
        for part, value in zip(self._ring.values(), row, strict=True):
            part[self.seen % self._capacity] = value
        self.seen += 1

    def __len__(self) -> int:
        return min(self.seen, self._capacity)

    @property
    def states(self) -> Vector:
        """`[N, F]` before the actions, the oldest first."""
        return self._in_order("states")

    @property
    def actions(self) -> NDArray[np.int64]:
        """`[N]` positions of the ground actions, −1 where the model knows none."""
        return self._in_order("actions")

    @property
    def next_states(self) -> Vector:
        """`[N, F]` observed after the actions."""
        return self._in_order("next_states")

    @property
    def over(self) -> NDArray[np.bool_]:
        """`[N]`, whether the environment ended the task with the step."""
        return self._in_order("over")

    @property
    def rewards(self) -> Vector:
        """`[N]` rewards of the steps."""
        return self._in_order("rewards")

    def _in_order(self, name: str) -> NDArray[Any]:
        """Return a copy of the rows in use, the oldest first."""
        count = len(self)
        return np.roll(self._ring[name][:count], -self.seen if count == self._capacity else 0, 0)

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays (only filled rows) and JSON values that restore it exactly."""
        arrays = {name: self._in_order(name) for name in self._ring}
        return arrays, {"capacity": self._capacity, "seen": self.seen}

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned; a `RunError` refuses what does not fit."""
        saved, capacity = Saved("experience", arrays, meta), self._capacity
        saved.equal("capacity", capacity, "continue with the task it was saved with")
        seen = saved.whole("seen")
        count = min(seen, capacity)
        # Observed states and rewards may contain any bits.
        bounds = {"actions": (-1, self._known_actions - 1)}
        parts = {}
        for name, ring in self._ring.items():
            shape = count, *ring.shape[1:]
            parts[name] = saved.array(name, ring.dtype, shape, *bounds.get(name, (None,)))
        for name, part in parts.items():
            # The oldest row lies where the next one will be written.
            self._ring[name][:count] = np.roll(part, seen if count == capacity else 0, 0)
        self.seen = seen
