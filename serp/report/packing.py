"""Arrays of numbers as text in a page: byte by byte, gzip, base64; `page/data.js` unpacks them."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_KEPT: Final = np.uint32(0xFFFFFF00)
"""Bits of a float32 that are kept: 15 of the 23 behind the binary point, more than four digits."""

Layout = list[tuple[str, str, int]]
"""Name, kind (`u1`, `u2`, `u4`, `f4`) and count of each array, in their order."""


def packed(arrays: Mapping[str, NDArray[Any]]) -> tuple[str, Layout]:
    """Return arrays as text, and their layout.

    Unsigned integers of 1, 2 or 4 bytes are kept exactly; all other numbers become float32 with at
    least four significant digits. Of each array the first bytes of all numbers come first, then the
    second bytes, and so on: equal bytes that follow one another pack well.
    """
    layout: Layout = []
    parts = []
    for name, array in arrays.items():
        flat = np.ascontiguousarray(array).ravel()
        if flat.dtype.kind != "u" or flat.dtype.itemsize > 4:
            flat = _rounded(flat)
        little = flat.astype(flat.dtype.newbyteorder("<"))
        layout.append((name, f"{little.dtype.kind}{little.itemsize}", len(little)))
        parts.append(little.view(np.uint8).reshape(-1, little.itemsize).T.tobytes())
    # mtime=0: equal data give equal bytes
    return base64.b64encode(gzip.compress(b"".join(parts), 6, mtime=0)).decode("ascii"), layout


def _rounded(numbers: NDArray[Any]) -> NDArray[np.float32]:
    with np.errstate(over="ignore"):  # beyond the range of float32 it is infinite
        single = numbers.astype(np.float32)
    bits = single.view(np.uint32)
    half = np.where(np.isfinite(single), np.uint32(0x80), np.uint32(0))
    rounded: NDArray[np.float32] = ((bits + half) & _KEPT).view(np.float32)
    return rounded
