"""Reading an exported folder: digests first, then JSON, arrays and the network as plain data."""

from __future__ import annotations

import hashlib
import io
import json
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FORMAT = 1
MANIFEST, POLICY, ARRAYS, NETWORK = "manifest.json", "policy.json", "arrays.npz", "learner.onnx"
FILES = (POLICY, ARRAYS, NETWORK)
"""The files whose digests the manifest holds."""

_DIGEST = re.compile("[0-9a-f]{64}")
_AGAIN = "copy the whole folder again, or export the run again with `serp export`"


class ControllerError(ValueError):
    """An exported folder, a state or an observation does not fit; the message says how."""


class Contents(NamedTuple):
    """What an exported folder holds.

    Attributes:
        path: The folder.
        manifest: What people and programs read of the policy.
        policy: The data that the controller decides by.
        arrays: Name → array.
        network: The learner, as ONNX.
    """

    path: Path
    manifest: dict[str, Any]
    policy: dict[str, Any]
    arrays: dict[str, NDArray[Any]]
    network: bytes


def read_folder(folder: str | Path) -> Contents:
    """Read an exported folder.

    Raises:
        ControllerError: It is no such folder, or a file is missing, changed or truncated.
    """
    path = Path(folder)
    if not path.is_dir():
        raise ControllerError(f"{path} is not a folder; give the one that `serp export` wrote")
    manifest = _object(path / MANIFEST, _read(path / MANIFEST))
    found = manifest.get("format")
    if found != FORMAT:
        raise ControllerError(
            f"{path / MANIFEST} has format {found!r}, and this controller reads format {FORMAT}; "
            "use the controller that lies in the folder, or export the run again"
        )
    digests = manifest.get("files")
    if not isinstance(digests, dict):
        raise ControllerError(f"{path / MANIFEST} does not list the folder's files; {_AGAIN}")
    read = {name: _checked(path / name, digests.get(name)) for name in FILES}
    try:
        with np.load(io.BytesIO(read[ARRAYS]), allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except Exception as error:
        raise ControllerError(f"{path / ARRAYS} holds no arrays: {error}; {_AGAIN}") from None
    return Contents(path, manifest, _object(path / POLICY, read[POLICY]), arrays, read[NETWORK])


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except FileNotFoundError:
        raise ControllerError(f"{file} is missing; {_AGAIN}") from None
    except OSError as error:
        raise ControllerError(f"cannot read {file}: {error.strerror or error}") from None


def _checked(file: Path, digest: object) -> bytes:
    content = _read(file)
    if not isinstance(digest, str) or not _DIGEST.fullmatch(digest):
        raise ControllerError(f"{file.parent / MANIFEST} has no digest of {file.name}; {_AGAIN}")
    if hashlib.sha256(content).hexdigest() != digest:
        raise ControllerError(f"{file} was changed or truncated since it was exported; {_AGAIN}")
    return content


def _object(file: Path, content: bytes) -> dict[str, Any]:
    try:
        read = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise ControllerError(f"{file} is not JSON: {error}; {_AGAIN}") from None
    if not isinstance(read, dict):
        raise ControllerError(f"{file} is not a JSON object; {_AGAIN}")
    return read
