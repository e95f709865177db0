"""Hash tables of positions, for compiled loops: where a state, or a key, is among those known.

A table is an int32 array of a power of two of slots, at least half of them empty (-1). Search goes
on from slot to slot (linear probing: Knuth, "The Art of Computer Programming" 3, section 6.4).
"""

from __future__ import annotations

import numpy as np

from serp._util.compilation import cached_njit

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

START = 0xCBF29CE484222325
"""The digest of nothing."""
_FACTOR = 0x9E3779B97F4A7C15


@cached_njit(nogil=True)
def table_size(entries):
    """Return the slots of a table for so many entries."""
    size = 2
    while size < 2 * entries:
        size *= 2
    return size


@cached_njit(nogil=True, forceinline=True)
def mixed(digest, bits):
    """Return a digest with 64 further bits mixed in."""
    digest = (digest ^ bits) * np.uint64(_FACTOR)
    return digest ^ (digest >> np.uint64(29))


@cached_njit(nogil=True, forceinline=True)
def bits_of(number):
    """Return the bits of a number; -0.0 equals 0.0."""
    return np.float64(number + 0.0).view(np.uint64)


@cached_njit(nogil=True, forceinline=True)
def finished(digest):
    """Return a digest all of whose bits depend on all that was mixed in."""
    return mixed(digest ^ (digest >> np.uint64(32)), np.uint64(0))


@cached_njit(nogil=True, forceinline=True)
def state_slot(table, mask, states, length, row, width):
    """Return the slot of the state that equals a row, or the empty slot for it.

    Args:
        table: The table.
        mask: Its slots in use, less 1.
        states: Flat, the known states.
        length: Numbers from one of them to the next.
        row: `[width]` array, or pointer.
        width: Numbers to compare.
    """
    digest = np.uint64(START)
    for i in range(width):
        digest = mixed(digest, bits_of(row[i]))
    slot = np.int64(finished(digest) & np.uint64(mask))
    while table[slot] >= 0:
        at = np.int64(table[slot]) * length
        equal = True
        for i in range(width):
            if states[at + i] != row[i]:
                equal = False
                break
        if equal:
            break
        slot = (slot + 1) & mask
    return slot


@cached_njit(nogil=True, forceinline=True)
def key_slot(table, keys, key):
    """Return the slot of a key (uint64), or the empty slot for it."""
    mask = table.shape[0] - 1
    slot = np.int64(key & np.uint64(mask))
    while table[slot] >= 0 and keys[table[slot]] != key:
        slot = (slot + 1) & mask
    return slot


@cached_njit(nogil=True)
def distinct(keys):
    """Return a table of keys `[N]`, the distinct ones in order, and which of these each is."""
    table = np.full(table_size(keys.shape[0]), -1, dtype=np.int32)
    found, which = np.empty_like(keys), np.empty(keys.shape[0], dtype=np.int64)
    count = 0
    for k in range(keys.shape[0]):
        slot = key_slot(table, found, keys[k])
        if table[slot] < 0:
            table[slot] = count
            found[count] = keys[k]
            count += 1
        which[k] = table[slot]
    return table, found[:count].copy(), which
