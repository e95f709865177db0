"""The loops of a network's two passes other than matrix products, compiled by numba.

As separate array operations, bias, LayerNorm, ReLU and their gradients cost more in calls than in
arithmetic.

All arrays are C-contiguous float32 unless stated otherwise. E is members, B batch, H a layer's
outputs, P parameters of a member. A layer's vectors are stored in the flat parameters ``[E, P]``
(and in the gradient likewise) from column `at` on: bias ``[H]`` and, with LayerNorm, gain ``[H]``
and shift ``[H]``.

Sums may be reordered for vector instructions, the same way in every run on one kind of machine;
NaN and infinities keep their meaning.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from serp._util.compilation import cached_njit

_F = TypeVar("_F", bound=Callable[..., Any])

NORM_EPSILON = 1e-5  # torch.nn.LayerNorm's
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


def aligned_zeros(*shape: int) -> npt.NDArray[np.float32]:
    """Return zeros aligned to 64 bytes, so that results do not depend on addresses."""
    count = math.prod(shape)
    memory = np.zeros(count + 16, np.float32)
    start = -memory.ctypes.data % 64 // 4
    return memory[start : start + count].reshape(shape)


def compiled(function: _F) -> _F:
    """Compile a loop with the arithmetic described above, on first use; cached on disk."""
    flags = {"reassoc", "contract", "nsz"}
    loop: _F = cached_njit(error_model="numpy", fastmath=flags)(function)
    return loop


@compiled
def add_bias(z: Any, parameters: Any, at: int, floor: Any) -> None:
    """Set z ``[E, B, H]`` to max(z + bias, floor): ReLU with floor 0, none with −inf."""
    members, batch, outputs = z.shape
    for e in range(members):
        bias = parameters[e, at : at + outputs]
        for i in range(batch):
            row = z[e, i]
            for j in range(outputs):
                value = row[j] + bias[j]
                row[j] = floor if value <= floor else value  # NaN stays NaN


@compiled
def normalize(z: Any, h: Any, inverse: Any, parameters: Any, at: int) -> None:
    """Set h ``[E, B, H]`` to ReLU(LayerNorm(z + bias)).

    z becomes the normalised value before gain and shift, `inverse` ``[E, B]`` the reciprocal of
    the standard deviation of each row.
    """
    members, batch, outputs = z.shape
    share = _ONE / np.float32(outputs)
    for e in range(members):
        bias = parameters[e, at : at + outputs]
        gain = parameters[e, at + outputs : at + 2 * outputs]
        shift = parameters[e, at + 2 * outputs : at + 3 * outputs]
        for i in range(batch):
            row, out = z[e, i], h[e, i]
            mean = _ZERO
            for j in range(outputs):
                row[j] += bias[j]
                mean += row[j]
            mean *= share
            variance = _ZERO
            for j in range(outputs):
                centred = row[j] - mean
                row[j] = centred
                variance += centred * centred
            factor = _ONE / np.sqrt(variance * share + np.float32(NORM_EPSILON))
            inverse[e, i] = factor
            for j in range(outputs):
                normal = row[j] * factor
                row[j] = normal
                value = normal * gain[j] + shift[j]
                out[j] = _ZERO if value <= _ZERO else value  # NaN stays NaN


@compiled
def add_bias_backward(d: Any, gradient: Any, at: int) -> None:
    """Write the gradient of an output layer's bias: the sum of d ``[E, B, H]`` over the batch."""
    members, batch, outputs = d.shape
    for e in range(members):
        bias = gradient[e, at : at + outputs]
        bias[:] = _ZERO
        for i in range(batch):
            row = d[e, i]
            for j in range(outputs):
                bias[j] += row[j]


@compiled
def relu_backward(d: Any, h: Any, gradient: Any, at: int) -> None:
    """Turn dloss/dh in d ``[E, B, H]`` into dloss/dz; write the gradient of the bias."""
    members, batch, outputs = d.shape
    for e in range(members):
        bias = gradient[e, at : at + outputs]
        bias[:] = _ZERO
        for i in range(batch):
            row, out = d[e, i], h[e, i]
            for j in range(outputs):
                value = row[j] if out[j] > _ZERO else _ZERO
                row[j] = value
                bias[j] += value


@compiled
def normalize_backward(
    d: Any, h: Any, z: Any, inverse: Any, parameters: Any, gradient: Any, at: int
) -> None:
    """Turn dloss/dh in d into dloss/dz; the other arrays are as `normalize` left them.

    Write the gradients of bias, gain and shift. With x the normalised row and g = d × gain,
    dz = (g − mean(g) − x · mean(g · x)) / standard deviation (arXiv 1607.06450).
    """
    members, batch, outputs = d.shape
    share = _ONE / np.float32(outputs)
    for e in range(members):
        gain = parameters[e, at + outputs : at + 2 * outputs]
        bias_gradient = gradient[e, at : at + outputs]
        gain_gradient = gradient[e, at + outputs : at + 2 * outputs]
        shift_gradient = gradient[e, at + 2 * outputs : at + 3 * outputs]
        bias_gradient[:] = _ZERO
        gain_gradient[:] = _ZERO
        shift_gradient[:] = _ZERO
        for i in range(batch):
            row, out, normal = d[e, i], h[e, i], z[e, i]
            # Loops over few arrays: the compiler vectorises only those, because it has to prove
            # that no array overlaps another.
            for j in range(outputs):
                value = row[j] if out[j] > _ZERO else _ZERO
                row[j] = value
                shift_gradient[j] += value
            for j in range(outputs):
                gain_gradient[j] += row[j] * normal[j]
            mean, along = _ZERO, _ZERO
            for j in range(outputs):
                value = row[j] * gain[j]
                row[j] = value
                mean += value
                along += value * normal[j]
            mean *= share
            along *= share
            factor = inverse[e, i]
            for j in range(outputs):
                value = factor * (row[j] - mean - normal[j] * along)
                row[j] = value
                bias_gradient[j] += value
