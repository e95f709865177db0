"""PDDL text with places, and the error that points at them."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from serp.errors import SerpError


@dataclass(frozen=True, eq=False)
class Source:
    """One PDDL file.

    Attributes:
        name: The file's path as the user wrote it; it opens every message.
        text: The whole content.
    """

    name: str
    text: str

    @classmethod
    def read(cls, path: str | Path) -> Source:
        """Read a file.

        Raises:
            DomainError: The file is missing, unreadable or not UTF-8.
        """
        if not isinstance(path, str | Path):
            raise DomainError(f"a file is given by its path, not by {path!r}")
        path = Path(path)
        try:
            # Some editors put a byte order mark first; it is no part of the text.
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


@dataclass(frozen=True, slots=True)
class Place:
    """A stretch of characters of one source."""

    source: Source
    start: int
    end: int

    @property
    def line(self) -> int:
        """Line number, from 1."""
        return self.source.text.count("\n", 0, self.start) + 1

    @property
    def column(self) -> int:
        """Column number, from 1."""
        return self.start - (self.source.text.rfind("\n", 0, self.start) + 1) + 1

    @property
    def text(self) -> str:
        """The text of the place, in one line."""
        return " ".join(self.source.text[self.start : self.end].split())

    @property
    def source_line(self) -> str:
        """The whole line on which the place begins, without its line break."""
        begin = self.source.text.rfind("\n", 0, self.start) + 1
        end = self.source.text.find("\n", begin)
        return self.source.text[begin : None if end < 0 else end].rstrip("\r")

    def __str__(self) -> str:
        return f"{self.source.name}:{self.line}:{self.column}"


class DomainError(SerpError):
    """Something is wrong in a domain or problem file.

    Attributes:
        problem: What is wrong, one sentence.
        advice: What to do about it; may be empty.
        place: Where, or None when no place in a file can be named.
        file, line, column, source_line: The place taken apart (None without one).
    """

    def __init__(self, problem: str, place: Place | None = None, advice: str = "") -> None:
        self.problem = _printable(problem)
        self.advice = _printable(advice)
        self.place = place
        self.file = place.source.name if place else None
        self.line = place.line if place else None
        self.column = place.column if place else None
        self.source_line = _printable(place.source_line) if place else None
        super().__init__(self._render())

    def _render(self) -> str:
        lines = [self.problem if self.place is None else f"{self.place}: {self.problem}"]
        if self.place is not None and self.source_line is not None:
            begin = self.place.column - 1
            width = max(1, min(self.place.end - self.place.start, len(self.source_line) - begin))
            margin = f"{self.line:>5} | "
            lines.append(margin + self.source_line)
            lines.append(" " * (len(margin) - 2) + "| " + " " * begin + "^" * width)
        if self.advice:
            lines.append(f"  {self.advice}")
        return "\n".join(lines)


def _printable(text: str) -> str:
    """Replace tabs and control characters, which would move the caret or drive the terminal."""
    return "".join(c if c.isprintable() else " " for c in text)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return advice naming the closest known word, or listing a few of them."""
    candidates = sorted(set(known))
    close = difflib.get_close_matches(word, candidates, n=1, cutoff=0.6)
    if close:
        return f"did you mean `{close[0]}`?"
    if not candidates:
        return ""
    listed = ", ".join(f"`{name}`" for name in candidates[:8])
    return f"known here: {listed}{', ...' if len(candidates) > 8 else ''}"
