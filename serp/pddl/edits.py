"""Changing a text in some places and leaving every other byte as it is."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Edit:
    """The characters `start` to `end` (exclusive) give way to a text; none do for an insertion."""

    start: int
    end: int
    text: str


@dataclass(frozen=True)
class Fix:
    """A change that mends what a finding tells of.

    Attributes:
        edits: Of the file of the finding.
        sure: Whether the change is what was meant, as far as a program can tell; otherwise it is a
            guess that somebody has to look at.
    """

    edits: tuple[Edit, ...]
    sure: bool = True


def edited(text: str, edits: Iterable[Edit]) -> str:
    """Return the text with all edits made; insertions at one place keep their order."""
    parts: list[str] = []
    position = 0
    for edit in sorted(edits, key=lambda e: (e.start, e.end)):
        if not position <= edit.start <= edit.end <= len(text):
            raise ValueError(f"edits overlap at character {edit.start}, or reach beyond the text")
        parts += [text[position : edit.start], edit.text]
        position = edit.end
    return "".join([*parts, text[position:]])


def line_start(text: str, position: int) -> int:
    """Return where the line begins in which a position lies."""
    return text.rfind("\n", 0, position) + 1


def line_end(text: str, position: int) -> int:
    """Return where that line ends, before its line break."""
    end = text.find("\n", position)
    end = len(text) if end < 0 else end
    return end - 1 if end > position and text[end - 1] == "\r" else end


def indent_at(text: str, position: int) -> str:
    """Return the white space with which the line of a position begins."""
    start = line_start(text, position)
    line = text[start : line_end(text, start)]
    return line[: len(line) - len(line.lstrip())]


def newline_of(text: str) -> str:
    """Return the line break that a text uses."""
    return "\r\n" if "\r\n" in text else "\n"
