"""The inputs of a residual and its features, for compiled loops.

`buffer` is the memory of `serp.adaptation.parameter_buffer` as a pointer, `part` the position of a
regression in it, see `serp.adaptation.residual.parameters`.
"""

from __future__ import annotations

import numpy as np

from serp._util.compilation import cached_njit
from serp.adaptation.residual import parameters as r

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

_CHUNK = r.SMOOTH


@cached_njit(nogil=True, forceinline=True)
def row_of(buffer, part, head, inputs, state):
    """Return the row of a head in a state: that of its mode, or its own."""
    bits = int(buffer[part + r.R_BITS])
    if bits == 0:
        return head
    positions, codes = int(buffer[part + r.R_POSITIONS]), int(buffer[part + r.R_CODES])
    heads = int(buffer[part + r.R_HEADS])
    code, weight = float(r.CODES * head), 1.0
    for k in range(bits):
        if state[int(buffer[inputs + int(buffer[positions + k])])] != 0.0:
            code += weight
        weight *= 2.0
    for row in range(heads, heads + int(buffer[part + r.R_MODES])):
        if buffer[codes + row] == code:
            return row
    return head


@cached_njit(nogil=True, forceinline=True)
def normalise(buffer, part, inputs, depth, state, u):
    """Write the normalised inputs of a state."""
    centre, shrink = int(buffer[part + r.R_CENTRE]), int(buffer[part + r.R_SHRINK])
    for i in range(depth):
        u[i] = (state[int(buffer[inputs + i])] - buffer[centre + i]) * buffer[shrink + i]


@cached_njit(nogil=True, forceinline=True)
def features_of(frequency, phase, u, depth, first, z):
    """Write a chunk of random features of normalised inputs, from position `first`, to `z`.

    A fast approximation of the cosine, accurate to 0.001, in loops that become vector code.
    """
    for k in range(_CHUNK):
        z[k] = phase[first + k]
    for i in range(depth):
        x, at = u[i], i * r.FEATURES + first
        for k in range(_CHUNK):
            z[k] += frequency[at + k] * x
    for k in range(_CHUNK):
        turns = z[k] * 0.15915494309189535 + 0.25
        turns -= np.floor(turns + 0.5)
        y = 8.0 * turns - 16.0 * turns * abs(turns)
        z[k] = 0.225 * (y * abs(y) - y) + y


@cached_njit(nogil=True, forceinline=True)
def dot_chunk(weights, z, scratch):
    """Return the product of two chunks, summed pairwise: in vector code, the same bits always."""
    for k in range(_CHUNK):
        scratch[k] = weights[k] * z[k]
    width = _CHUNK
    while width > 1:
        width //= 2
        for k in range(width):
            scratch[k] += scratch[k + width]
    return scratch[0]


@cached_njit(nogil=True, forceinline=True)
def linear_of(weights, u, depth):
    """Return a linear function of the normalised inputs."""
    total = weights[0]
    for i in range(depth):
        total += weights[1 + i] * u[i]
    return total
