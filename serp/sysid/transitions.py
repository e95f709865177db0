"""The newest transitions of a run, for estimation and for offline diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp._util.saved_state import Saved
from serp.model.transition_model import TransitionModel, Vector

CAPACITY: Final = 20_000
"""Most transitions that are kept."""

GOES_ON, CUT_OFF, OVER = 0, 1, 2
"""Ending of a step: the episode goes on, is cut off (truncated), or is over (terminated)."""

_MAX_NUMBERS: Final = 8_000_000
"""Most numbers in all states and next states: 64 MB."""

Ring = tuple[Vector, NDArray[np.int64], Vector, NDArray[np.int8], Vector]


def capacity_for(fluents: int) -> int:
    """Return how many transitions of `fluents` fluents are kept: at most 20,000, and 64 MB."""
    return min(CAPACITY, max(100, _MAX_NUMBERS // max(1, 2 * fluents)))


@cached_njit(nogil=True)
def store(transition, head, ring):  # type: ignore[no-untyped-def]
    """Write a transition into a ring; states must be as wide as the ring's.

    Args:
        transition: Arguments of `TransitionMemory.add`.
        head: Position that `TransitionMemory.advance` returned.
        ring: `TransitionMemory.ring`.
    """
    state, action, next_state, ending, reward = transition
    states, actions, next_states, endings, rewards = ring
    for f in range(state.shape[0]):
        states[head, f] = state[f]
        next_states[head, f] = next_state[f]
    actions[head] = action
    endings[head] = ending
    rewards[head] = reward


class TransitionMemory:
    """A ring buffer of the newest transitions: state, ground action, next state, ending, reward.

    The next state of a step that ended an episode is the last state of that episode, never the
    first one of the next.

    Args:
        capacity: Transitions kept, ≥ 1.
        fluents: Width of a state, F.
        actions: Number of ground actions, A.

    Attributes:
        capacity, fluents: As above.
        seen: Transitions added, including those overwritten.
        ring: States, actions, next states, endings and rewards, which `store` fills.

    Raises:
        ValueError: The capacity is not positive, or the width is negative.
    """

    def __init__(self, capacity: int, fluents: int, actions: int) -> None:
        if capacity < 1 or fluents < 0:
            raise ValueError(f"no memory has {capacity} transitions of {fluents} fluents")
        self._actions_known = actions
        self.capacity = capacity
        self.fluents = fluents
        self.seen = 0
        self._head = 0
        self._states: Vector = np.empty((capacity, fluents))
        self._next_states: Vector = np.empty((capacity, fluents))
        self._actions: NDArray[np.int64] = np.empty(capacity, np.int64)
        self._endings: NDArray[np.int8] = np.zeros(capacity, np.int8)
        self._rewards: Vector = np.zeros(capacity)
        self.ring: Ring = (
            self._states, self._actions, self._next_states, self._endings, self._rewards,
        )  # fmt: skip

    @classmethod
    def of(cls, model: TransitionModel) -> TransitionMemory:
        """Return an empty memory for the states and actions of a model."""
        width = len(model.fluents)
        return cls(capacity_for(width), width, len(model.actions))

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
        head = self.advance()
        self._states[head] = state
        self._actions[head] = action
        self._next_states[head] = next_state
        self._endings[head] = ending
        self._rewards[head] = reward

    def advance(self) -> int:
        """Return the position at which the caller writes the next transition."""
        head = self._head
        self.seen += 1
        self._head = 0 if head + 1 == self.capacity else head + 1
        return head

    def __len__(self) -> int:
        return min(self.seen, self.capacity)

    @property
    def states(self) -> Vector:
        """`[N, F]` before the actions, the oldest first."""
        return self._in_order(self._states)

    @property
    def actions(self) -> NDArray[np.int64]:
        """`[N]` positions of the ground actions, −1 where the model knows none."""
        return self._in_order(self._actions)

    @property
    def next_states(self) -> Vector:
        """`[N, F]` observed after the actions."""
        return self._in_order(self._next_states)

    @property
    def ended(self) -> NDArray[np.bool_]:
        """`[N]`, whether the episode ended with the step."""
        ended: NDArray[np.bool_] = self._in_order(self._endings) != GOES_ON
        return ended

    @property
    def over(self) -> NDArray[np.bool_]:
        """`[N]`, whether the environment ended the task with the step."""
        over: NDArray[np.bool_] = self._in_order(self._endings) == OVER
        return over

    @property
    def rewards(self) -> Vector:
        """`[N]` rewards of the steps."""
        return self._in_order(self._rewards)

    def _in_order(self, ring: NDArray[Any]) -> NDArray[Any]:
        """Return a copy of the rows in use, the oldest first."""
        if self.seen < self.capacity:
            return ring[: self.seen].copy()
        return np.concatenate((ring[self._head :], ring[: self._head]))

    # State -------------------------------------------------------------------------------------

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays (only filled rows) and JSON values that restore it exactly.

        Most next states equal the next row's state; only the others are saved.
        """
        states, next_states = self.states, self.next_states
        follows = np.zeros(len(self), np.bool_)
        if len(self):  # bit by bit: NaN equals itself, and −0 differs from 0
            follows[:-1] = (states[1:].view(np.int64) == next_states[:-1].view(np.int64)).all(1)
        arrays: dict[str, NDArray[Any]] = {
            "states": states,
            "actions": self.actions,
            "endings": self._in_order(self._endings),
            "rewards": self.rewards,
            "breaks": np.flatnonzero(~follows).astype(np.int64),
            "breaks.next_states": next_states[~follows],
        }
        return arrays, {"capacity": self.capacity, "fluents": self.fluents, "seen": self.seen}

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Continue from what `state_dict` returned.

        Raises:
            RunError: It has other fluents or another capacity, or is incomplete; this memory is
                unchanged.
        """
        saved, fluents = Saved("experience", arrays, meta), self.fluents
        for name, here in (("capacity", self.capacity), ("fluents", fluents)):
            saved.equal(name, here, "continue with the task and the settings it was saved with")
        seen = saved.whole("seen")
        count = min(seen, self.capacity)
        # Observed states may contain any bits.
        states = saved.array("states", np.float64, (count, fluents), low=None)
        actions = saved.array("actions", np.int64, (count,), -1, self._actions_known - 1)
        endings = saved.array("endings", np.int8, (count,), GOES_ON, OVER)
        rewards = saved.array("rewards", np.float64, (count,), low=None)
        breaks = saved.array("breaks", np.int64, (-1,), 0, count - 1)
        at_breaks = saved.array("breaks.next_states", np.float64, (len(breaks), fluents), low=None)
        # The last step has no next row.
        if (np.diff(breaks) <= 0).any() or (count and breaks[-1:] != count - 1):
            raise saved.wrong("breaks are in no order, or the last step has no next state")
        # The oldest row lies where the next one will be written.
        rows = (np.arange(count) + (seen if count == self.capacity else 0)) % self.capacity
        following = np.empty((count, self.fluents))
        following[:-1] = states[1:]
        following[breaks] = at_breaks
        self._states[rows] = states
        self._next_states[rows] = following
        self._actions[rows] = actions
        self._endings[rows] = endings
        self._rewards[rows] = rewards
        self.seen = seen
        self._head = seen % self.capacity
