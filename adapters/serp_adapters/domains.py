"""Shared by the tasks: paths of the shipped domain files, and observations that are states."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_FOLDERS = (
    Path(__file__).parent / "domains",  # in an installed wheel
    Path(__file__).parents[2] / "domains",  # in a checkout
)


def domain_file(name: str) -> Path:
    """Return the path of a shipped domain file.

    Raises:
        FileNotFoundError: There is none of that name.
    """
    for folder in _FOLDERS:
        path = folder / f"{name}.pddl"
        if path.is_file():
            return path
    raise FileNotFoundError(f"this installation ships no domain file {name}.pddl")


def as_observed(observation: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Ground an observation that has the fluents in the order of the domain file."""
    return np.asarray(observation, dtype=np.float64)
