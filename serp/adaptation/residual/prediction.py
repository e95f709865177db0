"""Evaluation of the residual in a predicted step; the same loops for every domain.

`buffer` is the memory of `serp.adaptation.parameter_buffer` as a pointer, `shared` the offset of
the shared part of a feature group.
"""

from __future__ import annotations

import numpy as np

from serp._util.compilation import cached_njit
from serp.adaptation import parameter_buffer as b

# mypy: disable-error-code="no-untyped-def, untyped-decorator"


@cached_njit(nogil=True, forceinline=True)
def cosine(z):
    """Return a fast approximation of the cosine, accurate to 0.001."""
    turns = z * 0.15915494309189535 + 0.25
    turns -= np.floor(turns + 0.5)
    y = 8.0 * turns - 16.0 * turns * abs(turns)
    return 0.225 * (y * abs(y) - y) + y


@cached_njit(nogil=True, forceinline=True)
def mode_of(buffer, shared, inputs, state):
    """Return the mode of a state; 0 for one without a separate model."""
    bits = int(buffer[shared + b.S_BITS])
    if bits == 0:
        return 0
    positions = int(buffer[shared + b.S_POSITIONS])
    code, weight = 0.0, 1.0
    for k in range(bits):
        if state[int(buffer[inputs + int(buffer[positions + k])])] != 0.0:
            code += weight
        weight *= 2.0
    codes = int(buffer[shared + b.S_CODES])
    for mode in range(1, int(buffer[shared + b.S_MODES]) + 1):
        if buffer[codes + mode] == code:
            return mode
    return 0


@cached_njit(nogil=True, forceinline=True)
def add_residual(buffer, action, state, out):
    """Add the residual to `out`, the fluents after effects and processes."""
    table = int(buffer[b.TABLE]) + 2 * action
    group = int(buffer[table + 1])
    for _ in range(int(buffer[table])):
        inputs, targets = int(buffer[group + b.G_INPUTS]), int(buffer[group + b.G_TARGETS])
        depth, count = int(buffer[group + b.G_DEPTH]), int(buffer[group + b.G_COUNT])
        shared = int(buffer[group + b.G_SHARED])
        mode = mode_of(buffer, shared, inputs, state)
        kinds = int(buffer[shared + b.S_KINDS]) + mode * count
        linear = int(buffer[shared + b.S_LINEAR])
        nonlinear = False
        for t in range(count):
            kind = int(buffer[kinds + t])
            if kind == b.FILE:
                continue
            row = 0
            if kind == b.OWN:
                row = mode
            elif kind == b.NONLINEAR:
                row = 1 + b.MODES
                nonlinear = True
            weights = linear + (row * count + t) * (1 + depth)
            change = buffer[weights]
            for i in range(depth):
                change += buffer[weights + 1 + i] * state[int(buffer[inputs + i])]
            out[int(buffer[targets + t])] += change
        if nonlinear:
            fourier = int(buffer[shared + b.S_FOURIER])
            centre, shrink = int(buffer[shared + b.S_CENTRE]), int(buffer[shared + b.S_SHRINK])
            frequency, phase = int(buffer[shared + b.S_FREQUENCY]), int(buffer[shared + b.S_PHASE])
            amplitude = int(buffer[shared + b.S_AMPLITUDE])
            for k in range(fourier):
                z = buffer[phase + k]
                for i in range(depth):
                    x = (state[int(buffer[inputs + i])] - buffer[centre + i]) * buffer[shrink + i]
                    z += buffer[frequency + k * depth + i] * x
                feature = cosine(z)
                for t in range(count):
                    if int(buffer[kinds + t]) == b.NONLINEAR:
                        out[int(buffer[targets + t])] += (
                            buffer[amplitude + t * fourier + k] * feature
                        )
        group += b.GROUP


@cached_njit(nogil=True)
def fourier_features(x, centre, shrink, frequency, phase, out):
    """Fill `out` with the random features of an input `[d]`, as `add_residual` computes them."""
    for k in range(phase.shape[0]):
        z = phase[k]
        for i in range(x.shape[0]):
            z += frequency[k, i] * ((x[i] - centre[i]) * shrink[i])
        out[k] = cosine(z)
