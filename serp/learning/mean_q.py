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
    """Computes Q of a network, averaged over a group; None: no averaging."""

    def __init__(self, network: QNetwork, symmetry: SymmetryGroup | None) -> None:
        self._network = network
        self._input_size, self._action_count = network.sizes[0], network.sizes[-1]
        self._group = symmetry or SymmetryGroup(self._input_size, self._action_count)
        self._images = self._group.averaged
        self._single = Workspace(network, self._images)
        self._many = Workspace(network, 0)

    def of(self, x: npt.NDArray[np.floating]) -> type_F32:
        """Return Q of every action; see `DQN.q_values`."""
        if x.ndim not in (1, 2) or x.shape[-1] != self._input_size:
            raise ValueError(
                f"an input must have shape ({self._input_size},) or (batch, {self._input_size}), "
                f"not {x.shape}"
            )
        rows = np.atleast_2d(x)
        of_each = self._of_each(rows)
        q: type_F32
        if self._images > 1:
            q = np.empty((len(rows), self._action_count), np.float32)
            _mean_over_images(of_each, self._group.actions, q)
        else:
            q = of_each[0].copy() if self._network.members == 1 else of_each.mean(axis=0)
        return q if x.ndim == 2 else q[0]

    def _of_each(self, x: npt.NDArray[np.floating]) -> type_F32:
        """Return Q ``[E, K · B, A]`` by each member of each of K images of B inputs."""
        rows = self._images * len(x)
        if len(x) != 1 and self._many.batch != rows:
            self._many = Workspace(self._network, rows)
        work = self._single if len(x) == 1 else self._many
        inputs = x.astype(np.float32, copy=False)
        if self._images > 1:
            images: type_F32 = np.empty((rows, self._input_size), np.float32)
            _all_images(
                np.ascontiguousarray(inputs), self._group.columns, self._group.signs, images
            )
            inputs = images
        return self._network.forward(inputs, work)


@compiled
def _all_images(x: Any, columns: Any, signs: Any, out: Any) -> None:
    """Compute the images of inputs under K elements of a symmetry group, element by element.

    x is ``[B, F]``, and out ``[K · B, F]`` is written.
    """
    batch, width = x.shape
    for r in range(len(out)):
        g, i = r // batch, r % batch
        for j in range(width):
            out[r, j] = signs[g, j] * x[i, columns[g, j]]


@compiled
def _mean_over_images(q: Any, images: Any, out: Any) -> None:
    """Write the mean of q ``[E, K · B, A]`` over members and images to out ``[B, A]``."""
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
