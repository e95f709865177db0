"""The Q-network: a small dense network, its forward pass and its hand-written backward pass.

All parameters are stored in one flat float32 array, so that the optimiser, the copy to a target
network and a checkpoint are single operations. The arithmetic is NumPy's matrix products and the
compiled loops of `loops.cpp`, in preallocated buffers. For networks of this size that
is several times faster than automatic differentiation, in which calls cost more than arithmetic.

Determinism: equal parameters, inputs of equal shape and an equal number of BLAS threads give equal
bits on one kind of machine. A single row and the same row in a batch agree only to float32
accuracy, because BLAS adds in another order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from serp import _core
from serp.learning.replay import type_F32


def aligned_zeros(*shape: int) -> type_F32:
    """Return zeros aligned to 64 bytes, so that results do not depend on addresses."""
    count = math.prod(shape)
    memory = np.zeros(count + 16, np.float32)
    start = -memory.ctypes.data % 64 // 4
    return memory[start : start + count].reshape(shape)


class _DenseLayer:
    """The location of one layer in the flat parameters.

    Attributes:
        weight, weight_gradient: Views ``[inputs, outputs]`` of parameters and gradient, or
            ``[members, inputs, outputs]`` with several members.
        start, bias, end: Columns of the first weight and bias, and the first after the layer.
    """

    def __init__(
        self, network: QNetwork, start: int, inputs: int, outputs: int, normalized: bool
    ) -> None:
        self.start = start
        self.bias = start + inputs * outputs
        self.end = self.bias + (3 if normalized else 1) * outputs
        self.inputs, self.outputs, self.normalized = inputs, outputs, normalized
        self.weight, self.weight_gradient = (
            _squeezed(flat[:, start : self.bias].reshape(-1, inputs, outputs))
            for flat in (network.parameters, network.gradient)
        )
        self.transposed = self.weight.swapaxes(-1, -2)


class _Buffers:
    """One layer's arrays for one batch size; `flat_` ones lack the axis of a single member."""

    def __init__(self, members: int, batch: int, layer: _DenseLayer) -> None:
        def zeros(*shape: int) -> type_F32:
            return aligned_zeros(members, batch, *shape)

        self.z = zeros(layer.outputs)  # before LayerNorm and ReLU
        self.h = zeros(layer.outputs) if layer.normalized else self.z  # after them
        self.inverse = zeros()  # 1 / standard deviation, under LayerNorm
        self.d = zeros(layer.outputs)  # gradient of the loss in h, then in z
        self.flat_z, self.flat_h, self.flat_d = map(_squeezed, (self.z, self.h, self.d))
        self.transposed_h = self.flat_h.swapaxes(-1, -2)


class Workspace:
    """Preallocated buffers for forward and backward passes over batches of one size.

    Attributes:
        q: ``[members, batch, A]``, the result of the last forward pass.
        q_gradient: Likewise; the caller writes dloss/dq here before `QNetwork.backward`, which may
            overwrite it.
    """

    def __init__(self, network: QNetwork, batch: int) -> None:
        self.batch = batch
        self._layers = [_Buffers(network.members, batch, layer) for layer in network.layers]
        self._input: type_F32 = np.zeros((batch, network.sizes[0]), np.float32)
        self.q = self._layers[-1].z
        self.q_gradient = self._layers[-1].d


class QNetwork:
    """One Q-network, or several of one shape side by side ("members").

    Args:
        sizes: Numbers in one input, F ≥ 1; neurons of each hidden layer, each followed by ReLU;
            Q-values of one input, A ≥ 1.
        layer_norm: LayerNorm before each ReLU.
        members: Networks side by side, E ≥ 1.
        rng: Draws the initial weights and biases, uniform in ±1/√inputs as in `torch.nn.Linear`;
            None: all parameters are 0 (a target network).

    Attributes:
        parameters: float32 ``[E, P]``: member by member, layer by layer the weights
            ``[inputs, outputs]``, the bias and, under LayerNorm, gain and shift.
        gradient: float32 ``[E, P]``, written by `backward`.
        layers: The location of each layer.
    """

    def __init__(
        self,
        sizes: Sequence[int],
        *,
        layer_norm: bool = False,
        members: int = 1,
        rng: np.random.Generator | None = None,
    ) -> None:
        self.sizes = tuple(sizes)
        self.members = members
        count = sum((n + 1) * m for n, m in pairwise(sizes)) + layer_norm * 2 * sum(sizes[1:-1])
        self.parameters = aligned_zeros(members, count)
        self.gradient = aligned_zeros(members, count)
        self.layers: list[_DenseLayer] = []
        start = 0
        for i, (inputs, outputs) in enumerate(pairwise(self.sizes)):
            normalized = layer_norm and i < len(self.sizes) - 2
            layer = _DenseLayer(self, start, inputs, outputs, normalized)
            self.layers.append(layer)
            start = layer.end
        self._work = Workspace(self, 1)
        if rng is not None:
            self._draw(rng)

    def _draw(self, rng: np.random.Generator) -> None:
        for layer in self.layers:
            gain, shift = layer.bias + layer.outputs, layer.bias + 2 * layer.outputs
            values = rng.random((self.members, gain - layer.start), np.float32)
            scale = np.float32(1.0 / math.sqrt(layer.inputs))
            self.parameters[:, layer.start : gain] = (2 * values - 1) * scale
            if layer.normalized:
                self.parameters[:, gain:shift] = 1.0

    def forward(self, inputs: type_F32, work: Workspace) -> type_F32:
        """Compute the Q-values of a batch.

        Args:
            inputs: ``[batch, F]`` for all members alike, or ``[members, batch, F]``; `backward`
                reads it again.
            work: Buffers for that batch size.

        Returns:
            `work.q`, valid until the next call.
        """
        if inputs.ndim == 3:
            inputs = _squeezed(inputs)
        work._input = inputs
        below = inputs
        for layer, here in zip(self.layers, work._layers, strict=True):
            np.matmul(below, layer.weight, out=here.flat_z)
            if layer.normalized:
                _core.normalize(here.z, here.h, here.inverse, self.parameters, layer.bias)
            else:
                floor = -math.inf if layer is self.layers[-1] else 0.0
                _core.add_bias(here.z, self.parameters, layer.bias, floor)
            below = here.flat_h
        return work.q

    def backward(self, work: Workspace) -> None:
        """Write the gradient of a loss into `gradient`; `work` is that of the last `forward`."""
        flat = self.gradient
        _core.add_bias_backward(work.q_gradient, flat, self.layers[-1].bias)
        for i in range(len(self.layers) - 1, 0, -1):
            layer, here = self.layers[i], work._layers[i]
            lower, below = self.layers[i - 1], work._layers[i - 1]
            np.matmul(below.transposed_h, here.flat_d, out=layer.weight_gradient)
            np.matmul(here.flat_d, layer.transposed, out=below.flat_d)
            if lower.normalized:
                _core.normalize_backward(
                    below.d, below.h, below.z, below.inverse, self.parameters, flat, lower.bias
                )
            else:
                _core.relu_backward(below.d, below.h, flat, lower.bias)
        transposed_input = work._input.swapaxes(-1, -2)
        np.matmul(transposed_input, work._layers[0].flat_d, out=self.layers[0].weight_gradient)

    def mean_q(self, x: npt.NDArray[np.floating]) -> type_F32:
        """Return Q of every action, the mean of the members; see `DQN.q_values`."""
        if x.ndim not in (1, 2) or x.shape[-1] != self.sizes[0]:
            raise ValueError(
                f"an input must have shape ({self.sizes[0]},) or (batch, {self.sizes[0]}), "
                f"not {x.shape}"
            )
        rows = np.atleast_2d(x).astype(np.float32, copy=False)
        if self._work.batch != len(rows):
            self._work = Workspace(self, len(rows))
        members = self.forward(rows, self._work)
        q: type_F32 = members[0].copy() if self.members == 1 else members.mean(axis=0)
        return q if x.ndim == 2 else q[0]


def _squeezed(array: type_F32) -> type_F32:
    """Remove the axis of a single member: a plain matrix product is the fastest."""
    return array[0] if len(array) == 1 else array
