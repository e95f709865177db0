"""JSON files for people and other programs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Any, Final

import numpy as np

from serp._util.files import read_regular
from serp.errors import RunError

_LARGEST: Final = 1 << 26
"""Largest size of a file that is read, in bytes."""


def json_text(value: object) -> str:
    """Return indented JSON that ends with a line break, of paths, enums and NumPy values, too.

    NaN and the infinities, which JSON cannot express, are a ValueError; see `finite`.
    """
    text = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False, default=_as_json)
    return text + "\n"


def finite(value: Any) -> Any:
    """Return a value with null for NaN and the infinities, which JSON does not have."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def read_json(file: Path, advice: str) -> dict[str, Any]:
    """Read a file that holds one JSON object.

    `advice` ends the message of the `RunError` if it cannot be read.
    """
    try:
        content = json.loads(read_regular(file, _LARGEST).decode("utf-8"))
    except OSError as error:
        raise RunError(f"cannot read {file}: {error.strerror or error}. {advice}") from error
    except (ValueError, RecursionError) as error:
        raise RunError(f"{file} is damaged ({error}). {advice}") from error
    if not isinstance(content, dict):
        raise RunError(f"{file} is damaged (not a JSON object). {advice}")
    return content


def _as_json(value: object) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"a {type(value).__name__} cannot be written as JSON")
