"""Samples: what the learner remembers of env steps, side by side in arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

type_F32 = npt.NDArray[np.float32]
type_I64 = npt.NDArray[np.int64]
type_Bool = npt.NDArray[np.bool_]

_OF_STEPS = ("observation", "action", "reward", "next_observation", "discount", "forbidden")
_OF_GUIDE = ("action", "value", "next_action", "next_values")


@dataclass(frozen=True, slots=True)
class GuideSamples:
    """What the guide said about samples; see `serp.learning.guidance.Guidance`.

    Attributes:
        action: int64 ``[*N]``, to be imitated in the state acted in; -1: nothing.
        value: float32 ``[*N]``, of the executed action in the state acted in.
        next_action: int64 ``[*N]``, in the state after the last reward; -1: none.
        next_values: float32 ``[*N, A]``, of the actions in that state.
    """

    action: type_I64
    value: type_F32
    next_action: type_I64
    next_values: type_F32

    @staticmethod
    def zeros(count: int, action_count: int) -> GuideSamples:
        """Room for `count` samples."""
        return GuideSamples(
            action=np.zeros(count, np.int64),
            value=np.zeros(count, np.float32),
            next_action=np.zeros(count, np.int64),
            next_values=np.zeros((count, action_count), np.float32),
        )

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Field → array."""
        return {name: getattr(self, name) for name in _OF_GUIDE}


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
        guide: what the guide said; None for a learner that does not learn from one.
    """

    observation: type_F32
    action: type_I64
    reward: type_F32
    next_observation: type_F32
    discount: type_F32
    forbidden: type_Bool
    guide: GuideSamples | None = None

    @staticmethod
    def zeros(
        count: int, observation_size: int, action_count: int, *, guided: bool = False
    ) -> Samples:
        """Room for `count` samples, with what a guide said about them or without."""
        return Samples(
            observation=np.zeros((count, observation_size), np.float32),
            action=np.zeros(count, np.int64),
            reward=np.zeros(count, np.float32),
            next_observation=np.zeros((count, observation_size), np.float32),
            discount=np.zeros(count, np.float32),
            forbidden=np.zeros((count, action_count), np.bool_),
            guide=GuideSamples.zeros(count, action_count) if guided else None,
        )

    def like(self, count: int) -> Samples:
        """Room for `count` samples of the same kind."""
        return Samples.zeros(
            count,
            self.observation.shape[-1],
            self.forbidden.shape[-1],
            guided=self.guide is not None,
        )

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Field → array; those of the guide as ``guide_action`` and so on."""
        own = {name: getattr(self, name) for name in _OF_STEPS}
        if self.guide is not None:
            own |= {f"guide_{name}": array for name, array in self.guide.arrays().items()}
        return own

    def at(self, rows: type_I64) -> Samples:
        """Copies of the samples in some rows of the leading axis."""
        return self._each(lambda array: array[rows])

    def reshaped(self, *lead: int) -> Samples:
        """Views with the one leading axis split into several."""
        return self._each(lambda array: array.reshape(*lead, *array.shape[1:]))

    def _each(self, view: Callable[[npt.NDArray[Any]], npt.NDArray[Any]]) -> Samples:
        own: dict[str, Any] = {name: view(getattr(self, name)) for name in _OF_STEPS}
        if self.guide is not None:
            guide: dict[str, Any] = {n: view(array) for n, array in self.guide.arrays().items()}
            own["guide"] = GuideSamples(**guide)
        return Samples(**own)
