"""PDDL text with places, and the error that points at them."""

from __future__ import annotations

import bisect
import functools
import re
import stat
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from serp.errors import SerpError

_LINE_END = re.compile(r"\r\n|\n|\r")
_LARGEST: Final = 1 << 28
"""Bytes of a file that is read."""
_WINDOW = 160
"""Most characters of a line that a message shows."""
_LONG_QUOTE = re.compile(r"`([^`]{160,})`")


@dataclass(frozen=True, eq=False)
class Source:
    """One PDDL file.

    Attributes:
        name: The file's path as the user wrote it; it opens every message.
        text: The whole content.
        warnings: Remarks on the file that are not errors, as `Place.warn` added it;
            `Domain.warnings` has each once.
    """

    name: str
    text: str
    warnings: list[DomainWarning] = field(default_factory=list, repr=False)

    @classmethod
    def read(cls, path: str | Path) -> Source:
        """Read a file.

        Raises:
            DomainError: The file is missing, unreadable, not a regular file (reading a pipe could
                block), or not UTF-8.
        """
        if not isinstance(path, str | Path):
            raise DomainError(f"a file is given by its path, not by {path!r}")
        path = Path(path)
        try:
            found = path.stat()
            if stat.S_ISDIR(found.st_mode):
                raise DomainError(f"{path}: cannot be read (it is a folder)")
            if not stat.S_ISREG(found.st_mode):
                raise DomainError(f"{path}: cannot be read (it is not a regular file)")
            if found.st_size > _LARGEST:
                raise DomainError(
                    f"{path}: cannot be read (it has {found.st_size:,} bytes, and a PDDL file at "
                    f"most {_LARGEST:,})"
                )
            # Some editors put a byte order mark first; it is not part of the text.
            return cls(str(path), path.read_bytes().decode("utf-8").removeprefix("\ufeff"))
        except FileNotFoundError:
            raise DomainError(f"{path}: there is no such file") from None
        except UnicodeDecodeError as error:
            raise DomainError(
                f"{path}: byte {error.start} is not valid UTF-8 text",
                advice="save the file as UTF-8",
            ) from None
        except OSError as error:
            raise DomainError(f"{path}: cannot be read ({error.strerror})") from None
        except ValueError as error:  # no path of this system: a null character
            raise DomainError(f"{str(path)!r}: cannot be read ({error})") from None

    def place(self, start: int, end: int) -> Place:
        """Return the place of the characters `start` to `end` (exclusive)."""
        return Place(self, start, end)

    @functools.cached_property
    def line_starts(self) -> list[int]:
        """Where each line begins; a line ends with a line feed, a carriage return, or both."""
        return [0, *(match.end() for match in _LINE_END.finditer(self.text))]

    def line_text(self, number: int) -> str:
        """Return a line, from 1, without its line break."""
        starts = self.line_starts
        end = starts[number] if number < len(starts) else len(self.text)
        return self.text[starts[number - 1] : end].rstrip("\r\n")


@dataclass(frozen=True, slots=True)
class Place:
    """A stretch of characters of one source."""

    source: Source
    start: int
    end: int

    @property
    def line(self) -> int:
        """Line number, from 1."""
        return bisect.bisect_right(self.source.line_starts, self.start)

    @property
    def column(self) -> int:
        """Column number, from 1."""
        return self.start - self.source.line_starts[self.line - 1] + 1

    @property
    def text(self) -> str:
        """The text of the place, in one line."""
        return " ".join(self.source.text[self.start : self.end].split())

    @property
    def source_line(self) -> str:
        """The whole line on which the place begins, without its line break."""
        return self.source.line_text(self.line)

    def warn(self, text: str) -> None:
        """Add a warning about this place to those of its file."""
        self.source.warnings.append(DomainWarning(text, self))

    def replaced(self, text: str) -> str:
        """Return the lines of the place, in one line, with other text in its stead."""
        lines, begin = self.source, self.source.line_starts[self.line - 1]
        last = bisect.bisect_right(lines.line_starts, max(self.start, self.end - 1))
        after = lines.text[self.end : lines.line_starts[last - 1] + len(lines.line_text(last))]
        return lines.text[begin : self.start] + text + after

    def __str__(self) -> str:
        return f"{self.source.name}:{self.line}:{self.column}"


@dataclass(frozen=True)
class DomainWarning:
    """A remark on a file that is not an error.

    Attributes:
        text: What, one sentence.
        place: Where; None where it concerns a file as a whole.
    """

    text: str
    place: Place | None = None

    def __str__(self) -> str:
        return printable(self.text if self.place is None else f"{self.place}: {self.text}")


class DomainError(SerpError):
    """Something is wrong in a domain or problem file.

    Attributes:
        problem: What is wrong, one sentence.
        advice: What to do about it; may be empty.
        place: Where, or None when no place in a file can be named.
        file, line, column: The place taken apart (None without one).
        source_line: The line of the place; of a long line what is around the place.
        corrected_line: The line as it may have been meant; empty where that is unknown.
    """

    def __init__(
        self,
        problem: str,
        place: Place | None = None,
        advice: str = "",
        *,
        write: str | None = None,
    ) -> None:
        """Describe what is wrong.

        Args:
            problem: One sentence.
            place: Where.
            advice: What to do about it.
            write: What to write there instead, where that is known.
        """
        self.problem = printable(problem)
        self.advice = printable(advice)
        self.place = place
        self.file = place.source.name if place else None
        self.line = place.line if place else None
        self.column = place.column if place else None
        self.source_line: str | None = None
        self.corrected_line = ""
        self._caret = 0
        if place is not None:
            self.source_line, self._caret = _window(place.source_line, place.column - 1)
            if write is not None:
                self.corrected_line = _window(place.replaced(write), place.column - 1)[0]
        super().__init__(self._render())

    def _render(self) -> str:
        place = self.place
        lines = [self.problem if place is None else f"{printable(str(place))}: {self.problem}"]
        if place is not None and self.source_line is not None:
            width = max(1, min(place.end - place.start, len(self.source_line) - self._caret))
            margin = f"{self.line:>5} | "
            blank = " " * (len(margin) - 2) + "| "
            lines.append(margin + self.source_line)
            lines.append(blank + " " * self._caret + "^" * width)
        if self.advice:
            lines.append(f"  {self.advice}")
        if self.corrected_line:
            lines += ["  write", f"{self.line:>5} | {self.corrected_line}"]
        return "\n".join(lines)


def printable(text: str) -> str:
    """Return a message without tabs and control characters, and without quotes of great length."""
    return _LONG_QUOTE.sub(lambda match: f"`{match[1][:80]} ... {match[1][-20:]}`", _visible(text))


def _visible(text: str) -> str:
    """Replace tabs and control characters, which would move the caret or drive the terminal."""
    return text if text.isprintable() else "".join(c if c.isprintable() else " " for c in text)


def _window(line: str, at: int) -> tuple[str, int]:
    """Return what of a line is around a column (from 0), and where that column is in it."""
    if len(line) <= _WINDOW:
        return _visible(line), at
    begin = max(0, min(at - _WINDOW // 2, len(line) - _WINDOW))
    end = begin + _WINDOW
    before, after = ("... " if begin else ""), (" ..." if end < len(line) else "")
    return before + _visible(line[begin:end]) + after, at - begin + len(before)
