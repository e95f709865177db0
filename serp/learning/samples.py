"""Samples of env steps that the learner stores, as arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

type_F32 = npt.NDArray[np.float32]
type_I64 = npt.NDArray[np.int64]
type_Bool = npt.NDArray[np.bool_]


class SampleSpec(NamedTuple):
    """The shape of a learner's samples: F inputs, A actions, and whether some imitate."""

    input_size: int
    action_count: int
    imitates: bool = False


class Samples(NamedTuple):
    """Samples, one array per field; the leading axes N are the same in all.

    The last field has no rows for a learner that does not imitate.

    Attributes:
        observation: float32 ``[*N, F]`` before the action.
        action: int64 ``[*N]``.
        reward: float32 ``[*N]``, the discounted sum of up to n rewards.
        next_observation: float32 ``[*N, F]`` after the last of them.
        discount: float32 ``[*N]``, γᵏ for k rewards; 0 where the episode terminated.
        forbidden: bool ``[*N, A]``, actions that may not be chosen next; never all.
        imitated: int64 ``[*N]``, action to be imitated in the current state; -1: none.
    """

    observation: type_F32
    action: type_I64
    reward: type_F32
    next_observation: type_F32
    discount: type_F32
    forbidden: type_Bool
    imitated: type_I64

    @staticmethod
    def zeros(count: int, spec: SampleSpec) -> Samples:
        """Allocate `count` samples."""
        return Samples(
            observation=np.zeros((count, spec.input_size), np.float32),
            action=np.zeros(count, np.int64),
            reward=np.zeros(count, np.float32),
            next_observation=np.zeros((count, spec.input_size), np.float32),
            discount=np.zeros(count, np.float32),
            forbidden=np.zeros((count, spec.action_count), np.bool_),
            imitated=np.zeros(count if spec.imitates else 0, np.int64),
        )

    def arrays(self) -> dict[str, npt.NDArray[np.generic]]:
        """Return field → array, without those that have no rows in this learner."""
        named = self._asdict()
        return {name: array for name, array in named.items() if len(array) == len(self.action)}

    def split(self, *lead: int) -> Samples:
        """Return views with the one leading axis split into several."""
        return Samples._make(a.reshape(*(lead if len(a) else (0,)), *a.shape[1:]) for a in self)
