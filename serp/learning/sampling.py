"""Drawing batches: random rows of the replay memory, each mapped by a random symmetry."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from serp.learning.kernels import compiled
from serp.learning.samples import Samples, SampleSpec, type_I64
from serp.learning.symmetry_group import SymmetryGroup


class Sampler:
    """Draws batches; each column is drawn from a range of rows. Memory is allocated once.

    Args:
        store: The rows.
        spec: Their shape.
        shape: Batches per draw, E ≥ 1, and columns of a batch, B ≥ 1.
        rng: Draws the samples; used exclusively by the sampler.
        symmetry: Every sample drawn is replaced by its image under an element of it, drawn
            uniformly; None: samples stay as they are.

    Attributes:
        rng: As above.
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
        group = symmetry or SymmetryGroup(spec.input_size, spec.action_count)
        self._group = (group.columns, group.signs, group.actions)
        self._order = len(group)
        count = shape[0] * shape[1]
        self._uniform = np.zeros(shape)
        self._rows: type_I64 = np.zeros(count, np.int64)
        self._elements: type_I64 = np.zeros(count, np.int64)
        self._counts = np.zeros(shape[1])
        self._starts: type_I64 = np.zeros(shape[1], np.int64)
        flat = Samples.zeros(count, spec)
        self._batch = flat.reshaped(*shape)
        # Plain tuples for the loops: memory and batch, without and of the guide.
        self._samples = (store[:6], flat[:6])
        self._guides = None
        if store.guide is not None and flat.guide is not None:
            self._guides = (tuple(store.guide), tuple(flat.guide))

    def divide(self, ranges: Iterable[tuple[int, int, int]]) -> None:
        """Set the rows from which the columns of a batch are drawn.

        Args:
            ranges: Number of columns, first row and number of rows of each range; the columns add
                up to those of a batch.
        """
        column = 0
        for columns, start, rows in ranges:
            self._starts[column : column + columns] = start
            self._counts[column : column + columns] = rows
            column += columns

    def draw(self) -> Samples:
        """Draw a batch for each member, uniformly and with replacement in each range.

        Returns:
            Samples with leading axes ``[members, batch]``, valid until the next draw.
        """
        self.rng.random(out=self._uniform)
        _choose_rows(self._uniform, self._starts, self._counts, self._rows)
        if self._order > 1:
            self.rng.random(out=self._uniform)
            # From float to integer rounds down.
            self._elements[:] = self._uniform.reshape(-1) * self._order
        _take_images(self._rows, self._elements, self._group, *self._samples)
        if self._guides is not None:
            _take_guide_images(self._rows, self._elements, self._group[2], *self._guides)
        return self._batch


@compiled
def _choose_rows(uniform: Any, starts: Any, counts: Any, rows: Any) -> None:
    """Turn uniform random numbers into rows of the replay memory.

    Args:
        uniform: float64 ``[E, B]``, in [0, 1).
        starts: int64 ``[B]``, the first row that a column of a batch is drawn from.
        counts: float64 ``[B]``, number of rows.
        rows: int64 ``[E · B]``, written.
    """
    members, batch = uniform.shape
    for e in range(members):
        for i in range(batch):
            rows[e * batch + i] = starts[i] + np.int64(uniform[e, i] * counts[i])


@compiled
def _take_images(rows: Any, elements: Any, group: Any, store: Any, out: Any) -> None:
    """Copy samples, each as its image under an element of a symmetry group.

    Args:
        rows: int64 ``[N]``, which samples.
        elements: int64 ``[N]``, the element for each.
        group: Columns, signs and actions of a `SymmetryGroup`.
        store: The memory, the first six fields of `Samples`.
        out: Likewise, N samples, written.
    """
    columns, signs, images = group
    observation, action, reward, next_observation, discount, forbidden = store
    to_observation, to_action, to_reward, to_next_observation, to_discount, to_forbidden = out
    width, count, alone = columns.shape[1], images.shape[1], len(columns) == 1
    for i in range(len(rows)):
        row, g = rows[i], elements[i]
        for j in range(width):
            if alone:  # the identity
                to_observation[i, j] = observation[row, j]
                to_next_observation[i, j] = next_observation[row, j]
            else:
                sign, column = signs[g, j], columns[g, j]
                to_observation[i, j] = sign * observation[row, column]
                to_next_observation[i, j] = sign * next_observation[row, column]
        to_action[i] = images[g, action[row]]
        to_reward[i] = reward[row]
        to_discount[i] = discount[row]
        for k in range(count):
            to_forbidden[i, images[g, k]] = forbidden[row, k]


@compiled
def _take_guide_images(rows: Any, elements: Any, images: Any, store: Any, out: Any) -> None:
    """Copy guidance, each sample as its image under an element of a symmetry group.

    Args:
        rows: int64 ``[N]``, which samples.
        elements: int64 ``[N]``, the element for each.
        images: int64 ``[G, A]``, the image of every action.
        store: The memory, the fields of `GuideSamples`.
        out: Likewise, N samples, written.
    """
    action, value, next_action, next_values = store
    to_action, to_value, to_next_action, to_next_values = out
    for i in range(len(rows)):
        row, g = rows[i], elements[i]
        said, then = action[row], next_action[row]
        to_action[i] = images[g, said] if said >= 0 else said
        to_value[i] = value[row]
        to_next_action[i] = images[g, then] if then >= 0 else then
        for k in range(images.shape[1]):
            to_next_values[i, images[g, k]] = next_values[row, k]
