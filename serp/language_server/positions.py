"""Places of files as editors count them: lines from 0, columns in units of an encoding."""

from __future__ import annotations

from lsprotocol import types

from serp.pddl.source import Place, Source

_ENCODINGS = {"utf-8": ("utf-8", 1), "utf-16": ("utf-16-le", 2), "utf-32": ("utf-32-le", 4)}


class Positions:
    """Converts between characters of a text and positions of an editor."""

    def __init__(self, encoding: str) -> None:
        """`encoding` is utf-8, utf-16 or utf-32, as client and server agreed."""
        self._encoding, self._bytes = _ENCODINGS[encoding]

    def position(self, source: Source, offset: int) -> types.Position:
        """Return the position of a character."""
        place = Place(source, offset, offset)
        before = source.line_text(place.line)[: place.column - 1]
        return types.Position(place.line - 1, len(before.encode(self._encoding)) // self._bytes)

    def offset(self, source: Source, position: types.Position) -> int:
        """Return the character at a position; the nearest one where there is none."""
        line = min(position.line + 1, len(source.line_starts))
        text = source.line_text(line).encode(self._encoding)
        before = text[: position.character * self._bytes].decode(self._encoding, "ignore")
        return source.line_starts[line - 1] + len(before)

    def range(self, place: Place) -> types.Range:
        """Return where a place is."""
        return types.Range(
            self.position(place.source, place.start), self.position(place.source, place.end)
        )

    def first_line(self, place: Place) -> types.Range:
        """Return where a place is, to the end of its first line."""
        source = place.source
        end = source.line_starts[place.line - 1] + len(place.source_line)
        return self.range(source.place(place.start, min(place.end, max(end, place.start))))
