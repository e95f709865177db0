"""Paths of the shipped domain files."""

from __future__ import annotations

from pathlib import Path

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
