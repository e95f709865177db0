"""Evaluation of the residual in a predicted step; the same loops for every domain.

`buffer` is the memory of `serp.adaptation.parameter_buffer` as a pointer.
"""

from __future__ import annotations

from serp._util.compilation import cached_njit
from serp.adaptation import parameter_buffer as b
from serp.adaptation.residual import parameters as r
from serp.adaptation.residual.features import (
    dot_chunk,
    features_of,
    linear_of,
    normalise,
    row_of,
)
from serp.adaptation.residual.leverage import leverage_at
from serp.model.native import STACK, advanced, stack_room
from serp.model.transition_model import UNKNOWN

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

_CHUNK = r.SMOOTH


@cached_njit(nogil=True, forceinline=True)
def add_residual(buffer, action, state, out):
    """Add the residual to `out`, the fluents after effects and processes.

    Beyond the range of the data, where these say less than the prior, the linear model replaces one
    with features, as in a Gaussian process whose mean is linear: waves say nothing of far away.
    """
    table = int(buffer[b.TABLE]) + 2 * action
    group = int(buffer[table + 1])
    u = stack_room(STACK)
    z, scratch = advanced(u, r.MAX_INPUTS), advanced(u, r.MAX_INPUTS + _CHUNK)
    for _ in range(int(buffer[table])):
        part = int(buffer[int(buffer[group + b.G_SHARED]) + b.S_REGRESSION])
        if part != 0:
            inputs, targets = int(buffer[group + b.G_INPUTS]), int(buffer[group + b.G_TARGETS])
            depth, count = int(buffer[group + b.G_DEPTH]), int(buffer[group + b.G_COUNT])
            head = int(buffer[int(buffer[group + b.G_SHARED]) + b.S_HEAD])
            row = row_of(buffer, part, head, inputs, state)
            kinds = int(buffer[part + r.R_KINDS])
            linear = int(buffer[part + r.R_LINEAR]) + 3 * row * count * (1 + depth)
            amplitude = int(buffer[part + r.R_AMPLITUDE])
            most = 0
            for t in range(count):
                most = max(most, int(buffer[kinds + t]))
            if most != r.FILE:
                normalise(buffer, part, inputs, depth, state, u)
            if most > r.LINEAR:
                inside = True
                for i in range(depth):
                    inside = inside and abs(u[i]) <= r.RANGE
                if not inside:
                    far = leverage_at(buffer, part, row, head, most, u, depth, z) >= UNKNOWN
                    most = r.LINEAR if far else most
            for t in range(count):
                kind = min(int(buffer[kinds + t]), most)
                if kind != r.FILE:
                    weights = linear + ((kind - 1) * count + t) * (1 + depth)
                    out[int(buffer[targets + t])] += linear_of(advanced(buffer, weights), u, depth)
            chunks = 0
            if most > r.LINEAR:
                chunks = 1 if most == r.CURVED else r.FEATURES // _CHUNK
            frequency = advanced(buffer, int(buffer[part + r.R_FREQUENCY]))
            phase = advanced(buffer, int(buffer[part + r.R_PHASE]))
            for chunk in range(chunks):
                first = chunk * _CHUNK
                features_of(frequency, phase, u, depth, first, z)
                for t in range(count):
                    kind = int(buffer[kinds + t])
                    if kind == r.FULL or (kind == r.CURVED and chunk == 0):
                        weights = amplitude + ((kind - r.CURVED) * count + t) * r.FEATURES + first
                        product = dot_chunk(advanced(buffer, weights), z, scratch)
                        out[int(buffer[targets + t])] += product
        group += b.GROUP
