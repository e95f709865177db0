"""Drawing batches: random rows of the replay memory, each mapped by a random symmetry."""

from __future__ import annotations

from typing import Any

import numpy as np

from serp.learning.kernels import compiled
from serp.learning.samples import Samples, SampleSpec, type_I64
from serp.learning.symmetry_group import SymmetryGroup


class Sampler:
    """Draws E batches of B of the first rows of `store`.

    Memory is allocated once. The other arguments are those of `ReplayBuffer`.
    """

    def __init__(
        self,
        store: Samples,
        spec: SampleSpec,
        shape: tuple[int, int],
        rng: np.random.Generator,
        symmetry: SymmetryGroup | None,
    ) -> None:
        self.rng = rng
        self._group = symmetry or SymmetryGroup(spec.input_size, spec.action_count)
        self._uniform = np.zeros(shape)
        self._elements: type_I64 = np.zeros(shape, np.int64)
        drawn = Samples.zeros(shape[0] * shape[1], spec)
        self._batch = drawn.split(*shape)
        # Plain tuples for the loop.
        self._tables = (tuple(store), tuple(drawn))
        self._symmetries = (self._group.columns, self._group.signs, self._group.actions)

    def draw(self, count: int) -> Samples:
        """Draw a batch for each member from the first rows, uniformly and with replacement.

        Returns:
            Samples with leading axes ``[members, batch]``, valid until the next draw.
        """
        self.rng.random(out=self._uniform)
        rows = (self._uniform * count).astype(np.int64)
        if len(self._group) > 1:
            self.rng.random(out=self._uniform)
            self._elements[:] = self._uniform * len(self._group)  # rounds down
        _take_images(rows.ravel(), self._elements.ravel(), self._symmetries, *self._tables)
        return self._batch


@compiled
def _take_images(rows: Any, elements: Any, symmetries: Any, store: Any, out: Any) -> None:
    """Copy samples, each as its image under an element of a symmetry group.

    Args:
        rows: int64 ``[N]``, which samples.
        elements: int64 ``[N]``, the element for each.
        symmetries: Columns, signs and actions of a `SymmetryGroup`.
        store: The memory, the fields of `Samples`.
        out: Likewise, N samples, written.
    """
    columns, signs, images = symmetries
    observation, action, reward, next_observation, discount, forbidden, imitated = store
    (
        to_observation, to_action, to_reward, to_next_observation, to_discount, to_forbidden,
        to_imitated,
    ) = out  # fmt: skip
    imitates = len(imitated) > 0
    for i in range(len(rows)):
        row, g = rows[i], elements[i]
        for j in range(columns.shape[1]):
            sign, column = signs[g, j], columns[g, j]
            to_observation[i, j] = sign * observation[row, column]
            to_next_observation[i, j] = sign * next_observation[row, column]
        to_action[i] = images[g, action[row]]
        to_reward[i] = reward[row]
        to_discount[i] = discount[row]
        for k in range(images.shape[1]):
            to_forbidden[i, images[g, k]] = forbidden[row, k]
        if imitates:
            to_imitated[i] = images[g, imitated[row]] if imitated[row] >= 0 else -1
