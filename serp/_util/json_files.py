"""JSON that people and other programs read: config.json and summary.json."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Any, Final

import numpy as np

from serp._util.regular_files import read_regular
from serp.errors import RunError

_LARGEST: Final = 1 << 26
"""Bytes of a file that is read."""


def json_text(value: object) -> str:
    """Indented JSON with a line break at its end; paths, enums and NumPy values are known.

    Raises:
        TypeError: a value has no form in JSON.
        ValueError: a number is NaN or infinite, for which JSON has no form either; see `finite`.
    """
    text = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False, default=_as_json)
    return text + "\n"


def finite(value: Any) -> Any:
    """The same value with null for NaN and the infinities, which strict readers refuse."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def read_json(file: Path, advice: str) -> dict[str, Any]:
    """Reads a file that holds one JSON object.

    Args:
        file: where it is.
        advice: what the user should do where it cannot be read.

    Raises:
        RunError: it cannot be read, or holds something else.
    """
    try:
        content = json.loads(read_regular(file, _LARGEST).decode("utf-8"))
    except OSError as error:
        raise RunError(f"cannot read {file}: {error.strerror or error}. {advice}") from error
    except (ValueError, RecursionError) as error:
        raise RunError(f"{file} is damaged ({error}). {advice}") from error
    if not isinstance(content, dict):
        raise RunError(f"{file} is damaged (no JSON object). {advice}")
    return content


def _as_json(value: object) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"a {type(value).__name__} cannot be written as JSON")
