"""A reflection of a learner's inputs and actions: what holds on the left holds on the right.

A reflection maps an input x to x' and an action a to a', and back. Where a task has it, Q of x' and
a' is Q of x and a. It has two uses: a sample of the replay memory represents its mirror image, too,
and the mean of Q over both has that property exactly (van der Pol et al. 2020, arXiv 2006.16908,
build it into the network instead).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt


class Reflection:
    """A signed permutation that is its own inverse: x'[i] = signs[i] · x[columns[i]].

    Args:
        columns: For each of F inputs, the input that it is exchanged with, or itself.
        signs: Likewise 1 or -1.
        actions: For each of A actions, the action that it is exchanged with, or itself.

    Attributes:
        columns, signs, actions: int64 `[F]`, float32 `[F]`, int64 `[A]`.

    Raises:
        ValueError: It is not its own inverse.
    """

    def __init__(
        self, columns: Sequence[int], signs: Sequence[float], actions: Sequence[int]
    ) -> None:
        self.columns = np.array(columns, np.int64)
        self.signs = np.array(signs, np.float32)
        self.actions = np.array(actions, np.int64)
        for what, exchanged in (("columns", self.columns), ("actions", self.actions)):
            places = np.arange(len(exchanged))
            if (
                set(exchanged.tolist()) != set(places.tolist())
                or (exchanged[exchanged] != places).any()
            ):
                raise ValueError(f"{what} {exchanged.tolist()} do not exchange pairs")
        if self.signs.shape != self.columns.shape or (np.abs(self.signs) != 1.0).any():
            raise ValueError(f"{self.signs.tolist()} are not {len(self.columns)} times 1 or -1")
        if (self.signs != self.signs[self.columns]).any():
            raise ValueError("inputs that are exchanged have different signs")

    def as_lists(self) -> tuple[list[int], list[float], list[int]]:
        """Return the arguments that make it."""
        return self.columns.tolist(), self.signs.tolist(), self.actions.tolist()

    def of_inputs(self, x: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the mirror images of inputs `[..., F]`, of the same dtype."""
        image: npt.NDArray[Any] = x[..., self.columns] * self.signs.astype(x.dtype)
        return image

    def of_actions(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return what the mirror images of actions have, for what actions have: `[..., A]`."""
        image: npt.NDArray[Any] = values[..., self.actions]
        return image
