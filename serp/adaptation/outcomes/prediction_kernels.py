"""The compiled outcomes of an action: what they predict, and how probable they are.

An outcome is what the file predicts for the action, what it predicts for another action with the
same arguments (a robot that slips; walls and conditions of the file hold then, too), or a change of
the state, within the ranges in which fluents were observed.

`buffer` is the memory of `serp.adaptation.parameter_buffer`, `table` that of
`serp.adaptation.outcomes.table_kernels`, all as pointers. `room` is scratch memory, see `room_for`.
"""

from __future__ import annotations

from serp._util.compilation import cached_njit
from serp.adaptation import parameter_buffer as b
from serp.adaptation.file_step import flow
from serp.adaptation.outcomes import table_kernels as c
from serp.model.flags import APPLICABLE
from serp.model.native import advanced

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

RARE = 1e-3
"""Less likely outcomes are left out of predictions."""
CHANGE = -1.0
"""In place of an action schema: the outcome is a change."""

# Positions in `room`, in multiples of KINDS, before a step `[F + 1]` and values `[KINDS, columns]`.
PROBABILITIES, SCRATCH, FIT, ENDS, STEP = range(5)


@cached_njit(nogil=True, forceinline=True)
def room_for(width):
    """Return the length of the scratch memory for states of `width` fluents."""
    return STEP * c.KINDS + width + 1 + c.KINDS * width


@cached_njit(nogil=True, forceinline=True)
def values_of(room, width, columns, kind):
    """Return a pointer to the counted fluents that an outcome predicts."""
    return advanced(room, STEP * c.KINDS + width + 1 + kind * columns)


@cached_njit(nogil=True, forceinline=True)
def table_of(buffer, group):
    """Return the offset of a group's outcome counts from the buffer; 0 where it has none."""
    return int(buffer[int(buffer[group + b.G_SHARED]) + b.S_OUTCOMES])


@cached_njit(nogil=True, forceinline=True)
def _by_schema(buffer, action, schema, table, inputs, state, dt, values, step):
    """Write the counted fluents as the file predicts for another action; return whether it does."""
    other = int(buffer[int(buffer[b.OTHERS]) + action * int(buffer[b.SCHEMAS]) + schema])
    if other < 0:
        return False
    if not flow(buffer, other, state, dt, step) & APPLICABLE:
        return False
    places = int(table[c.T_PLACES])
    for k in range(int(table[c.T_COLUMNS])):
        values[k] = step[int(inputs[int(table[places + k])])]
    return True


@cached_njit(nogil=True, forceinline=True)
def _by_change(table, kind, inputs, state, values):
    """Write the counted fluents after a change.

    Returns:
        Whether those that change are within the ranges in which they were observed.
    """
    columns, places, ranges = (
        int(table[c.T_COLUMNS]),
        int(table[c.T_PLACES]),
        int(table[c.T_RANGES]),
    )
    changes = int(table[c.T_CHANGES]) + kind * columns
    within = True
    for k in range(columns):
        by = table[changes + k]
        values[k] = state[int(inputs[int(table[places + k])])] + by
        inside = table[ranges + 2 * k] <= values[k] <= table[ranges + 2 * k + 1]
        within = within and (by == 0.0 or inside)
    return within


@cached_njit(nogil=True, forceinline=True)
def predict(buffer, action, table, kind, inputs, state, flowed, dt, room):
    """Write what an outcome predicts, see `values_of`; return whether it is possible.

    `flowed` `[F]` is the state after effects, processes and residual.
    """
    width, columns = int(buffer[b.WIDTH]), int(table[c.T_COLUMNS])
    values = values_of(room, width, columns, kind)
    if kind == 0:
        places = int(table[c.T_PLACES])
        for k in range(columns):
            values[k] = flowed[int(inputs[int(table[places + k])])]
        return True
    schema = table[int(table[c.T_SCHEMAS]) + kind]
    if schema == CHANGE:
        return _by_change(table, kind, inputs, state, values)
    step = advanced(room, STEP * c.KINDS)
    return _by_schema(buffer, action, int(schema), table, inputs, state, dt, values, step)


@cached_njit(nogil=True, forceinline=True)
def put(buffer, table, kind, inputs, room, out):
    """Set the counted fluents as an outcome predicts."""
    columns, places = int(table[c.T_COLUMNS]), int(table[c.T_PLACES])
    values = values_of(room, int(buffer[b.WIDTH]), columns, kind)
    for k in range(columns):
        out[int(inputs[int(table[places + k])])] = values[k]


@cached_njit(nogil=True, forceinline=True)
def alike(room, width, columns, kind, other):
    """Return whether two outcomes predict the same."""
    one, two = values_of(room, width, columns, kind), values_of(room, width, columns, other)
    different = 0
    for k in range(columns):
        different += one[k] != two[k]
    return different == 0


@cached_njit(nogil=True, forceinline=True)
def _merge(table, room, width, probabilities):
    """Give the probability of outcomes that predict the same to the first of them."""
    columns = int(table[c.T_COLUMNS])
    for kind in range(1, int(table[c.T_KINDS])):
        for other in range(kind):
            both = probabilities[kind] > 0.0 and probabilities[other] > 0.0
            if both and alike(room, width, columns, kind, other):
                probabilities[other] += probabilities[kind]
                probabilities[kind] = 0.0


@cached_njit(nogil=True)
def likeliest(buffer, action, group, state, flowed, dt, room):
    """Return the likeliest outcome of a group with counts.

    The first numbers of `room` become the probabilities of the outcomes, no two of which predict
    the same; `put` applies one.
    """
    table = advanced(buffer, table_of(buffer, group))
    inputs = advanced(buffer, int(buffer[group + b.G_INPUTS]))
    probabilities, scratch = room, advanced(room, SCRATCH * c.KINDS)
    c.fill_probabilities(table, inputs, state, probabilities, scratch)
    kinds, left = int(table[c.T_KINDS]), 0.0
    for kind in range(kinds):
        usual = kind == 0 or probabilities[kind] >= RARE
        if not (usual and predict(buffer, action, table, kind, inputs, state, flowed, dt, room)):
            probabilities[kind] = 0.0
        left += probabilities[kind]
    if left <= RARE:
        probabilities[0] = left = 1.0
    _merge(table, room, int(buffer[b.WIDTH]), probabilities)
    best = 0
    for kind in range(kinds):
        probabilities[kind] /= left
        if probabilities[kind] > probabilities[best]:
            best = kind
    return best
