"""Q of an input: the mean over the members and over its mirror images."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from serp.learning.network import QNetwork, Workspace
from serp.learning.samples import type_F32
from serp.learning.symmetry_group import SymmetryGroup


class MeanQ:
    """Computes Q of networks of one shape, averaged over a group; None: no averaging."""

    def __init__(self, network: QNetwork, symmetry: SymmetryGroup | None) -> None:
        self._input_size, self._action_count = network.sizes[0], network.sizes[-1]
        group = symmetry or SymmetryGroup(self._input_size, self._action_count)
        self._images = group.averaged
        self._columns = group.columns[: group.averaged]
        self._signs = group.signs[: group.averaged, np.newaxis]
        self._actions = group.actions[: group.averaged, np.newaxis]
        self._single = Workspace(network, self._images)
        self._many = Workspace(network, 0)

    def of(
        self,
        network: QNetwork,
        x: npt.NDArray[np.floating],
        base: npt.NDArray[np.floating] | None,
    ) -> type_F32:
        """Return Q of every action plus `base`; see `DQN.q_values`."""
        if x.ndim not in (1, 2) or x.shape[-1] != self._input_size:
            raise ValueError(
                f"an input must have shape ({self._input_size},) or (batch, {self._input_size}), "
                f"not {x.shape}"
            )
        of_each = self._of_each(network, np.atleast_2d(x))
        members, images, batch, actions = of_each.shape
        q: type_F32 = of_each.reshape(members * images, batch, actions).mean(axis=0)
        q = q if x.ndim == 2 else q[0]
        if base is not None:
            if base.shape != q.shape and base.shape != (self._action_count,):
                raise ValueError(f"the guide's values must have shape {q.shape}, not {base.shape}")
            q += base.astype(np.float32, copy=False)
        return q

    def of_members(self, network: QNetwork, x: npt.NDArray[np.floating]) -> type_F32:
        """Return Q of every action by each member, ``[members, A]``, for one input ``[F]``."""
        mean: type_F32 = self._of_each(network, x[np.newaxis])[:, :, 0].mean(axis=1)
        return mean

    def _of_each(self, network: QNetwork, x: npt.NDArray[np.floating]) -> type_F32:
        """Return Q ``[E, K, B, A]`` by each member of each of K images, mapped back."""
        rows = self._images * len(x)
        if len(x) != 1 and self._many.batch != rows:
            self._many = Workspace(network, rows)
        work = self._single if len(x) == 1 else self._many
        inputs = x.astype(np.float32, copy=False)
        if self._images == 1:
            return network.forward(inputs, work)[:, np.newaxis]
        images = inputs[:, self._columns].swapaxes(0, 1) * self._signs
        q = network.forward(np.ascontiguousarray(images).reshape(rows, -1), work)
        shape = (network.members, self._images, len(x), self._action_count)
        each: type_F32 = np.take_along_axis(
            q.reshape(shape), np.broadcast_to(self._actions, shape), axis=3
        )
        return each
