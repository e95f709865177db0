"""The actions of an environment, counted from 0."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from gymnasium import spaces

MOST_COMBINATIONS: Final = 4096
"""Each is an output of the learner's network, and a column of every forecast."""


class ActionSpace:
    """The actions 0 ... size-1 of a discrete space.

    Those of a `MultiDiscrete` or `MultiBinary` space are its combinations, of which the last number
    counts fastest. All are counted from 0, wherever the space begins.

    Raises:
        ValueError: The space is of another kind, or has more than `MOST_COMBINATIONS` combinations.
    """

    def __init__(self, space: Any) -> None:
        self.space = space
        self._shape: tuple[int, ...] | None = None
        if isinstance(space, spaces.Discrete):
            self.size = int(space.n)
            return
        if isinstance(space, spaces.MultiDiscrete):
            self._shape = tuple(space.nvec.ravel().tolist())
        elif isinstance(space, spaces.MultiBinary):
            self._shape = (2,) * int(np.prod(space.shape))
        else:
            raise ValueError(
                f"serp needs discrete actions, this environment has {space}; offer a few "
                "controllers as actions: serp_envs.MacroActions"
            )
        self.size = int(np.prod(self._shape, dtype=object))
        if self.size > MOST_COMBINATIONS:
            raise ValueError(
                f"{space} has {self.size:,} combinations, more than {MOST_COMBINATIONS:,}; "
                "offer those that make sense as a Discrete space, through "
                "gymnasium.wrappers.TransformAction"
            )

    def action(self, number: int) -> Any:
        """Return what the environment's `step` takes for the action with a number."""
        if self._shape is None:
            return int(self.space.start) + number
        places = np.array(np.unravel_index(number, self._shape), dtype=self.space.dtype)
        return places.reshape(self.space.shape) + getattr(self.space, "start", 0)

    def number(self, action: Any) -> Any:
        """Return the number of an action that is given as a sequence of numbers from 0.

        Raises:
            ValueError: The space has no such combination.
        """
        if self._shape is None or not isinstance(action, Sequence | np.ndarray):
            return action  # a number already
        try:
            return int(np.ravel_multi_index(np.array(action).ravel().tolist(), self._shape))
        except (TypeError, ValueError):
            most = ", ".join(str(count - 1) for count in self._shape)
            raise ValueError(f"expected a number, or a tuple from 0 to ({most})") from None
