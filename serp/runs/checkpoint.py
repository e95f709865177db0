"""Checkpoints: arrays and JSON in one safetensors file, with a digest, never a pickle.

The file is an ordinary safetensors file. Its metadata has one entry, ``serp``, because safetensors
writes several in no fixed order. That is the text of a JSON object::

    {"format": 15, "sha256": "<digest of the content>", "meta": "<text of a JSON object>"}

Numbers in ``meta`` stay exact: integers of any size (a PCG64 state has 128 bits), and NaN and the
infinities, which are written as Python's `json` writes them. What cannot be read or written is a
`RunError`.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import safetensors.numpy
from safetensors import SafetensorError

from serp._util.files import as_json, read_regular, write_durably
from serp.errors import RunError

FORMAT: Final = 15
CHECKPOINT: Final = "checkpoint.safetensors"
"""Name of the checkpoint in the folder of a run."""
_RESTORE: Final = "Restore it from a copy, or train again."


class Checkpoint(NamedTuple):
    """The content of a checkpoint: name → writable array as saved, and the JSON values."""

    arrays: dict[str, np.ndarray[Any, Any]]
    meta: dict[str, Any]


def save(path: Path, arrays: Mapping[str, np.ndarray[Any, Any]], meta: Mapping[str, Any]) -> None:
    """Write a checkpoint atomically and durably, in place of an existing one; see `as_bytes`."""
    write_durably(path, as_bytes(arrays, meta))


def as_bytes(arrays: Mapping[str, np.ndarray[Any, Any]], meta: Mapping[str, Any]) -> bytes:
    """Return the content of a checkpoint's file.

    Arrays may have any shape (also 0-d and empty), JSON values may be NumPy scalars.
    """
    # Not `ascontiguousarray`, which makes 0-d arrays one-dimensional.
    plain = {name: np.asarray(array, order="C") for name, array in arrays.items()}
    text = json.dumps(meta, default=as_json)
    entry = {"format": FORMAT, "sha256": _digest(plain, text), "meta": text}
    return safetensors.numpy.save(plain, {"serp": json.dumps(entry)})


def load(path: Path) -> Checkpoint:
    """Read what `save` wrote, exactly."""
    if not os.path.lexists(path):
        raise RunError(
            f"there is no checkpoint {path}. A run can be continued or evaluated once it has "
            "written its first checkpoint."
        )
    data = read_regular(path, advice=_RESTORE)
    length_bytes = 8  # a safetensors file begins with the length of its header
    damaged = f"the checkpoint {path} is damaged:"
    try:
        loaded = safetensors.numpy.load(data)
        size = int.from_bytes(data[:length_bytes], "little")
        header = json.loads(data[length_bytes : length_bytes + size])
    except (SafetensorError, ValueError, KeyError, RecursionError) as error:
        raise RunError(f"{damaged} it is truncated or altered ({error}). {_RESTORE}") from error
    text = (header.get("__metadata__") or {}).get("serp")
    if text is None:
        raise RunError(f"{path} is a safetensors file, but not a checkpoint of serp.")
    try:
        entry = json.loads(text)
        if entry["format"] != FORMAT:
            raise RunError(
                f"the checkpoint {path} has format {entry['format']}, which another version of "
                f"serp wrote; this version reads format {FORMAT}. Use the version that config.json "
                "names, or train again."
            )
        if _digest(loaded, entry["meta"]) != entry["sha256"]:
            raise RunError(
                f"{damaged} its content is not what was written (the digest differs). {_RESTORE}"
            )
        meta = json.loads(entry["meta"])
        if not isinstance(meta, dict):
            raise ValueError("not a JSON object")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise RunError(f"{damaged} its metadata cannot be read. {_RESTORE}") from error
    # safetensors may return arrays over immutable bytes, but the state is modified after loading.
    arrays = {name: a if a.flags.writeable else a.copy() for name, a in loaded.items()}
    return Checkpoint(arrays, meta)


def _digest(arrays: Mapping[str, np.ndarray[Any, Any]], meta: str) -> str:
    """Return the SHA-256 of the JSON, then of name, dtype, shape and bytes of each array."""
    digest = hashlib.sha256(meta.encode())
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(json.dumps([name, array.dtype.name, array.shape]).encode())
        digest.update(array.data if array.size else b"")
    return digest.hexdigest()
