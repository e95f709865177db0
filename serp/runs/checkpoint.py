"""Checkpoints: arrays and JSON in one safetensors file, with a digest, never a pickle.

The file is an ordinary safetensors file. Its metadata has one entry, ``serp``, a JSON object::

    {"format": 7, "sha256": "<digest of the content>", "meta": {...}}

It is one entry because safetensors writes several in no fixed order; equal states give equal bytes.
Integers of any size stay exact (a PCG64 state has 128 bits). NaN and the infinities, which JSON
does not have, are written as ``{"float": "nan"}``, ``{"float": "inf"}``, ``{"float": "-inf"}``.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy
from safetensors import SafetensorError

from serp._util.files import aside_of, read_regular, replaced_durably, write_durably, write_flushed
from serp.errors import RunError

FORMAT = 7
NEWEST = "checkpoint.safetensors"
PREVIOUS = "checkpoint-previous.safetensors"
DAMAGED = "checkpoint-damaged.safetensors"

_ADVICE = (
    "No checkpoint is left to continue from: restore a checkpoint from a copy, or train again with "
    "another --out. metrics.csv and decisions.csv can still be read."
)
_ENTRY = "serp"
_FLOAT = "float"
_FLOATS = {str(value): value for value in (math.nan, math.inf, -math.inf)}
_LENGTH_BYTES = 8  # a safetensors file begins with the length of its header


class CheckpointDamaged(RunError):
    """A checkpoint is truncated or altered."""


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint that `load_newest` has read.

    Attributes:
        arrays: Name → writable array with the saved dtype and shape.
        meta: The JSON values saved with them.
        path: The file that was read.
        fallback: Why the previous checkpoint was read; None if the newest one is intact.
    """

    arrays: dict[str, np.ndarray[Any, Any]]
    meta: dict[str, Any]
    path: Path
    fallback: str | None = None


def save(
    path: Path | str, arrays: Mapping[str, np.ndarray[Any, Any]], meta: Mapping[str, Any]
) -> None:
    """Write a checkpoint atomically and durably.

    Args:
        path: The file; an existing one is replaced after the new one is flushed to the disk.
        arrays: Name → array of any shape (also 0-d and empty) of booleans, integers or floats.
        meta: JSON values with strings as keys; NumPy scalars are allowed.

    Raises:
        RunError: The write failed; the previous checkpoint is unchanged.
        TypeError: An array or a value has a type that the file cannot hold.
    """
    write_durably(Path(path), _encode(arrays, meta))


def load(path: Path | str) -> tuple[dict[str, np.ndarray[Any, Any]], dict[str, Any]]:
    """Read what `save` wrote, exactly: writable arrays and the JSON values.

    Raises:
        CheckpointDamaged: The file is truncated or altered.
        RunError: There is no such file, it cannot be read, it is not a checkpoint of serp, or
            another version of serp wrote it.
    """
    path = Path(path)
    try:
        data = read_regular(path)
    except FileNotFoundError as error:
        raise RunError(
            f"there is no checkpoint {path}. A run can be continued or evaluated once it has "
            "written its first checkpoint."
        ) from error
    except OSError as error:
        raise RunError(f"cannot read the checkpoint {path}: {error.strerror or error}.") from error
    return _decode(path, data)


def save_rotating(
    folder: Path | str, arrays: Mapping[str, np.ndarray[Any, Any]], meta: Mapping[str, Any]
) -> Path:
    """Write ``checkpoint.safetensors``, and keep the last one as the previous one.

    That is ``checkpoint-previous.safetensors``. After the first call the folder always holds at
    least one intact checkpoint.

    Returns:
        The file written.

    Raises:
        RunError: The write failed; the previous checkpoint is unchanged.
        TypeError: See `save`.
    """
    newest = Path(folder) / NEWEST
    data = _encode(arrays, meta)
    with replaced_durably(newest) as aside:
        write_flushed(aside, data)
        if newest.exists():
            _keep(newest, newest.with_name(PREVIOUS))
    return newest


def load_newest(folder: Path | str) -> Checkpoint:
    """Read the newest intact checkpoint of a folder.

    If the newest file is missing or damaged, the previous one is read, and `fallback` of the result
    says so.

    Raises:
        CheckpointDamaged: The newest is damaged and there is no intact previous one.
        RunError: There is no checkpoint, it cannot be read, or another version of serp wrote it.
    """
    newest, previous = Path(folder) / NEWEST, Path(folder) / PREVIOUS
    if os.path.lexists(newest) or not os.path.lexists(previous):
        try:
            arrays, meta = load(newest)
        except CheckpointDamaged as error:
            if not os.path.lexists(previous):
                raise CheckpointDamaged(f"{error} {_ADVICE}") from error
            fallback = str(error)
        else:
            return Checkpoint(arrays, meta, newest)
    else:
        fallback = f"there is no {newest}."
    try:
        arrays, meta = load(previous)
    except CheckpointDamaged as error:
        raise CheckpointDamaged(f"{fallback} The one before it: {error} {_ADVICE}") from error
    return Checkpoint(arrays, meta, previous, fallback)


def _keep(newest: Path, previous: Path) -> None:
    """Make `previous` a second name of `newest`, so that a reader always finds a newest one."""
    link = aside_of(previous)
    try:
        link.unlink(missing_ok=True)
        os.link(newest, link)
    except OSError:  # no hard links on this file system
        os.replace(newest, previous)
        return
    os.replace(link, previous)
    # After a crash both may be the same file, and a rename between its two names does nothing.
    link.unlink(missing_ok=True)


def _encode(arrays: Mapping[str, np.ndarray[Any, Any]], meta: Mapping[str, Any]) -> bytes:
    plain = {name: _plain(name, array) for name, array in arrays.items()}
    strict = _strict(meta)
    entry = {"format": FORMAT, "sha256": _digest(plain, strict), "meta": strict}
    text = json.dumps(entry, allow_nan=False, default=_unknown)
    return safetensors.numpy.save(plain, {_ENTRY: text})


def _plain(name: str, array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Return the array in the layout of the file: C order, little-endian, a supported dtype."""
    array = np.asarray(array)
    if array.dtype.kind not in "biuf" or array.dtype.itemsize > 8:
        raise TypeError(f"array {name!r} has dtype {array.dtype}, which a checkpoint cannot hold")
    # Not `ascontiguousarray`, which makes 0-d arrays one-dimensional.
    return np.asarray(array, dtype=array.dtype.newbyteorder("<"), order="C")


def _decode(path: Path, data: bytes) -> tuple[dict[str, np.ndarray[Any, Any]], dict[str, Any]]:
    def damaged(why: str) -> CheckpointDamaged:
        return CheckpointDamaged(f"the checkpoint {path} is damaged: {why}.")

    try:
        loaded = safetensors.numpy.load(data)
        size = int.from_bytes(data[:_LENGTH_BYTES], "little")
        header = json.loads(data[_LENGTH_BYTES : _LENGTH_BYTES + size])
    except (SafetensorError, ValueError, KeyError, RecursionError) as error:
        raise damaged(f"it is truncated or altered ({error})") from error
    text = (header.get("__metadata__") or {}).get(_ENTRY)
    if text is None:
        raise RunError(f"{path} is a safetensors file, but not a checkpoint of serp.")
    try:
        entry = json.loads(text)
        version, digest, meta = entry["format"], entry["sha256"], entry["meta"]
        if type(version) is not int or version < 1 or not isinstance(meta, dict):
            raise ValueError(f"format {version!r}")
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise damaged("its metadata cannot be read") from error
    if version > FORMAT:
        raise RunError(
            f"the checkpoint {path} has format {version}; this serp knows formats up to {FORMAT}. "
            "Install a newer serp to read it."
        )
    if version < FORMAT:
        raise RunError(
            f"the checkpoint {path} has format {version}, which an earlier serp wrote; this one "
            f"reads format {FORMAT}. Use the run with the version that config.json names, or train "
            "again."
        )
    if _digest(loaded, meta) != digest:
        raise damaged("its content is not what was written (the digest differs)")
    # safetensors may return arrays over immutable bytes, but the state is modified after loading.
    arrays = {name: a if a.flags.writeable else a.copy() for name, a in loaded.items()}
    try:
        return arrays, _exact(meta)
    except (KeyError, TypeError, IndexError, RecursionError) as error:
        raise damaged("its metadata cannot be read") from error


def _strict(value: Any) -> Any:
    """Return the value in strict JSON: text, truth values, null and finite numbers."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return {_FLOAT: str(value)}
    if isinstance(value, Mapping):
        strict = {key: _strict(item) for key, item in value.items()}
        # A mapping that has this form itself is marked by a list around its value.
        return {_FLOAT: [strict[_FLOAT]]} if set(strict) == {_FLOAT} else strict
    return [_strict(item) for item in value] if isinstance(value, list | tuple) else value


def _exact(value: Any) -> Any:
    """Return the value that `_strict` was given."""
    if isinstance(value, list):
        return [_exact(item) for item in value]
    if not isinstance(value, dict):
        return value
    if set(value) == {_FLOAT}:
        inner = value[_FLOAT]
        return {_FLOAT: _exact(inner[0])} if isinstance(inner, list) else _FLOATS[inner]
    return {key: _exact(item) for key, item in value.items()}


def _unknown(value: object) -> Any:
    raise TypeError(f"a checkpoint's JSON cannot hold a {type(value).__name__}")


def _digest(arrays: Mapping[str, np.ndarray[Any, Any]], meta: Mapping[str, Any]) -> str:
    """Return the SHA-256 of the JSON, then of name, dtype, shape and bytes of each array."""
    digest = hashlib.sha256(json.dumps(meta, sort_keys=True, default=_unknown).encode())
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(json.dumps([name, array.dtype.name, array.shape]).encode())
        digest.update(array.data if array.size else b"")
    return digest.hexdigest()
