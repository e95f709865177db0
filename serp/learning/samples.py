"""Samples of env steps that the learner stores, as arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

type_F32 = npt.NDArray[np.float32]
type_I64 = npt.NDArray[np.int64]
type_Bool = npt.NDArray[np.bool_]


class SampleSpec(NamedTuple):
    """The shape of a learner's samples.

    Attributes:
        input_size: Numbers in an input, F ≥ 1.
        action_count: Actions, A ≥ 1.
        guided: Whether samples contain guidance.
    """

    input_size: int
    action_count: int
    guided: bool = False


class GuideSamples(NamedTuple):
    """Guidance of samples; see `serp.learning.guidance.Guidance`.

    Attributes:
        action: int64 ``[*N]``, to be imitated in the current state; -1: none.
        value: float32 ``[*N]``, of the executed action in the current state.
        next_action: int64 ``[*N]``, in the state after the last reward; -1: none.
        next_values: float32 ``[*N, A]``, of the actions in that state.
    """

    action: type_I64
    value: type_F32
    next_action: type_I64
    next_values: type_F32


class Samples(NamedTuple):
    """Samples, one array per field; the leading axes N are the same in all.

    Attributes:
        observation: float32 ``[*N, F]`` before the action.
        action: int64 ``[*N]``.
        reward: float32 ``[*N]``, the discounted sum of up to n rewards.
        next_observation: float32 ``[*N, F]`` after the last of them.
        discount: float32 ``[*N]``, γᵏ for k rewards; 0 where the episode terminated.
        forbidden: bool ``[*N, A]``, actions that may not be chosen next; never all.
        guide: Guidance; None for a learner without a guide.
    """

    observation: type_F32
    action: type_I64
    reward: type_F32
    next_observation: type_F32
    discount: type_F32
    forbidden: type_Bool
    guide: GuideSamples | None = None

    @staticmethod
    def zeros(count: int, spec: SampleSpec) -> Samples:
        """Allocate `count` samples."""
        inputs, actions = (count, spec.input_size), (count, spec.action_count)
        guide = GuideSamples(
            action=np.zeros(count, np.int64),
            value=np.zeros(count, np.float32),
            next_action=np.zeros(count, np.int64),
            next_values=np.zeros(actions, np.float32),
        )
        return Samples(
            observation=np.zeros(inputs, np.float32),
            action=np.zeros(count, np.int64),
            reward=np.zeros(count, np.float32),
            next_observation=np.zeros(inputs, np.float32),
            discount=np.zeros(count, np.float32),
            forbidden=np.zeros(actions, np.bool_),
            guide=guide if spec.guided else None,
        )

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return field → array; those of the guide as ``guide_action`` and so on."""
        own: dict[str, Any] = dict(zip(self._fields[:-1], self[:-1], strict=True))
        if self.guide is not None:
            own |= {f"guide_{name}": array for name, array in self.guide._asdict().items()}
        return own

    def at(self, rows: type_I64) -> Samples:
        """Return copies of the samples in some rows of the leading axis."""
        return self._each(lambda array: array[rows])

    def reshaped(self, *lead: int) -> Samples:
        """Return views with the one leading axis split into several."""
        return self._each(lambda array: array.reshape(*lead, *array.shape[1:]))

    def _each(self, function: Callable[[Any], Any]) -> Samples:
        guide = None if self.guide is None else GuideSamples(*map(function, self.guide))
        return Samples._make([*map(function, self[:-1]), guide])
