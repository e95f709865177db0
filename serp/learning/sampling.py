"""Drawing batches: rows of the replay memory, at random, each as an image under the symmetries."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from serp.learning import guided_kernels, kernels
from serp.learning.samples import GuideSamples, Samples, type_I64
from serp.learning.symmetry_group import SymmetryGroup


class Sampler:
    """Draws batches, a column from some range of rows each. Allocates once.

    Args:
        store: the rows.
        members: batches a draw, E ≥ 1.
        batch_size: columns of a batch, B ≥ 1.
        rng: draws the samples; from now on the sampler's own.
        symmetry: every sample drawn is replaced by its image under an element of it, drawn
            uniformly; None: samples stay as they are.

    Attributes:
        rng: that generator.
    """

    def __init__(
        self,
        store: Samples,
        members: int,
        batch_size: int,
        rng: np.random.Generator,
        symmetry: SymmetryGroup | None,
    ) -> None:
        self.rng = rng
        self._store = store
        self._symmetry = symmetry
        self._uniform = np.zeros((members, batch_size))
        self._rows: type_I64 = np.zeros(members * batch_size, np.int64)
        self._counts = np.zeros(batch_size)
        self._starts: type_I64 = np.zeros(batch_size, np.int64)
        self._flat = store.like(members * batch_size)
        self._batch = self._flat.reshaped(members, batch_size)

    def divide(self, ranges: Iterable[tuple[int, int, int]]) -> None:
        """Says which rows the columns of a batch are drawn from.

        Args:
            ranges: of so many columns: how many, the first row, how many rows. Together they are
                as many columns as a batch has.
        """
        column = 0
        for columns, start, rows in ranges:
            self._starts[column : column + columns] = start
            self._counts[column : column + columns] = rows
            column += columns

    def draw(self) -> Samples:
        """A batch for each member, uniformly and with replacement in each range.

        Returns:
            Samples with leading axes ``[members, batch]``, valid until the next draw.
        """
        store, out, symmetry = self._store, self._flat, self._symmetry
        self.rng.random(out=self._uniform)
        kernels.choose_rows(self._uniform, self._starts, self._counts, self._rows)
        if symmetry is not None:
            self._take_images(symmetry)
            return self._batch
        kernels.take_samples(
            self._rows,
            store.observation, store.action, store.reward,
            store.next_observation, store.discount, store.forbidden,
            out.observation, out.action, out.reward,
            out.next_observation, out.discount, out.forbidden,
        )  # fmt: skip
        if store.guide is not None and out.guide is not None:
            self._take_guide(store.guide, out.guide)
        return self._batch

    def _take_guide(self, store: GuideSamples, out: GuideSamples) -> None:
        # Every row exists; mode "clip" only spares take a copy of its output.
        flat = self._rows
        store.action.take(flat, out=out.action, mode="clip")
        store.value.take(flat, out=out.value, mode="clip")
        store.next_action.take(flat, out=out.next_action, mode="clip")
        store.next_values.take(flat, axis=0, out=out.next_values, mode="clip")

    def _take_images(self, symmetry: SymmetryGroup) -> None:
        self.rng.random(out=self._uniform)
        elements = (self._uniform.reshape(-1) * len(symmetry)).astype(np.int64)  # rounds down
        store, out = self._store, self._flat
        kernels.take_images(
            self._rows, elements, symmetry.columns, symmetry.signs, symmetry.actions,
            store.observation, store.action, store.reward,
            store.next_observation, store.discount, store.forbidden,
            out.observation, out.action, out.reward,
            out.next_observation, out.discount, out.forbidden,
        )  # fmt: skip
        if store.guide is not None and out.guide is not None:
            store.guide.value.take(self._rows, out=out.guide.value, mode="clip")
            guided_kernels.take_guide_images(
                self._rows, elements, symmetry.actions,
                store.guide.action, store.guide.next_action, store.guide.next_values,
                out.guide.action, out.guide.next_action, out.guide.next_values,
            )  # fmt: skip
