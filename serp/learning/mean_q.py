"""Q of an input: the mean over the members and over its mirror images."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from serp.learning.kernels import compiled
from serp.learning.network import QNetwork, Workspace
from serp.learning.samples import type_F32
from serp.learning.symmetry_group import SymmetryGroup


class MeanQ:
    """Computes Q-values of networks of one shape.

    Args:
        network: A network of that shape.
        symmetry: The group over which Q is averaged; None: no averaging.
    """

    def __init__(self, network: QNetwork, symmetry: SymmetryGroup | None) -> None:
        self._input_size, self._action_count = network.sizes[0], network.sizes[-1]
        self._symmetry = symmetry
        self._single = Workspace(network, self._rows(1))
        self._many = Workspace(network, 0)

    def _rows(self, inputs: int) -> int:
        """Return the number of network inputs for a number of inputs."""
        return inputs if self._symmetry is None else inputs * self._symmetry.averaged

    def of(
        self,
        network: QNetwork,
        x: npt.NDArray[np.floating],
        base: npt.NDArray[np.floating] | None,
    ) -> type_F32:
        """Return Q of every action.

        Args:
            network: The network.
            x: One input ``[F]`` or a batch ``[B, F]``.
            base: ``[A]`` or ``[B, A]``, added; None: nothing.

        Returns:
            ``[A]`` or ``[B, A]``, float32; a new array.

        Raises:
            ValueError: The input or `base` has another shape.
        """
        q: type_F32
        if x.ndim == 1:
            if x.shape != (self._input_size,):
                raise ValueError(f"an input must have shape ({self._input_size},), not {x.shape}")
            q = self._mean(network, x[np.newaxis], self._single)[0]
        elif x.ndim != 2 or x.shape[1] != self._input_size:
            raise ValueError(
                f"an input must have shape ({self._input_size},) or (batch, {self._input_size}), "
                f"not {x.shape}"
            )
        else:
            if self._many.batch != self._rows(len(x)):
                self._many = Workspace(network, self._rows(len(x)))
            q = self._mean(network, x, self._many)
        if base is not None:
            if base.shape != q.shape and base.shape != (self._action_count,):
                raise ValueError(f"the guide's values must have shape {q.shape}, not {base.shape}")
            q += base.astype(np.float32, copy=False)
        return q

    def _mean(self, network: QNetwork, x: npt.NDArray[np.floating], work: Workspace) -> type_F32:
        inputs = x.astype(np.float32, copy=False)
        if self._symmetry is not None:
            return self._mean_over_images(self._symmetry, network, inputs, work)
        q = network.forward(inputs, work)
        mean: type_F32 = q[0].copy() if network.members == 1 else q.mean(axis=0)
        return mean

    def _mean_over_images(
        self, symmetry: SymmetryGroup, network: QNetwork, x: type_F32, work: Workspace
    ) -> type_F32:
        images = self._images(symmetry, x, work)
        mean: type_F32 = np.empty((len(x), self._action_count), np.float32)
        _mean_over_images(network.forward(images, work), symmetry.actions, mean)
        return mean

    def _images(self, symmetry: SymmetryGroup, x: type_F32, work: Workspace) -> type_F32:
        images: type_F32 = np.empty((work.batch, self._input_size), np.float32)
        _all_images(np.ascontiguousarray(x), symmetry.columns, symmetry.signs, images)
        return images

    def of_members(self, network: QNetwork, x: npt.NDArray[np.floating]) -> type_F32:
        """Return Q of every action by each member, the mean over mirror images.

        Args:
            network: The network.
            x: One input ``[F]``.

        Returns:
            ``[members, A]``, float32; a new array.
        """
        inputs = x[np.newaxis].astype(np.float32, copy=False)
        if self._symmetry is None:
            q: type_F32 = network.forward(inputs, self._single)[:, 0].copy()
            return q
        group = self._symmetry
        images = self._images(group, inputs, self._single)
        q = network.forward(images, self._single)
        own = np.take_along_axis(q, group.actions[np.newaxis, : len(images)], axis=2)
        mean: type_F32 = own.mean(axis=1)
        return mean


@compiled
def _all_images(x: Any, columns: Any, signs: Any, out: Any) -> None:
    """Compute the images of inputs under K elements of a symmetry group, element by element.

    Args:
        x: ``[B, F]``.
        columns: int64 ``[G, F]``; image[i] = signs[g, i] × input[columns[g, i]].
        signs: ``[G, F]``.
        out: ``[K · B, F]``, K ≤ G, written.
    """
    batch, width = x.shape
    for r in range(len(out)):
        g, i = r // batch, r % batch
        for j in range(width):
            out[r, j] = signs[g, j] * x[i, columns[g, j]]


@compiled
def _mean_over_images(q: Any, images: Any, out: Any) -> None:
    """Compute the mean of Q over members and a symmetry group.

    Args:
        q: ``[E, K · B, A]`` of what `_all_images` wrote.
        images: int64 ``[G, A]``, the image of every action.
        out: ``[B, A]``, written.
    """
    members, rows, actions = q.shape
    batch = len(out)
    share = np.float32(1.0) / np.float32(members * (rows // batch))
    out[:, :] = np.float32(0.0)
    for e in range(members):
        for r in range(rows):
            g, i = r // batch, r % batch
            for k in range(actions):
                out[i, k] += q[e, r, images[g, k]]
    for i in range(batch):
        for k in range(actions):
            out[i, k] *= share
