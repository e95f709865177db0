"""PDDL text with places, and the error that points at them; see `serp.pddl.error_message`."""

from __future__ import annotations

import bisect
import functools
import re
import stat
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

from serp.errors import SerpError
from serp.pddl.error_message import Excerpt, error_message, printable


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


_LINE_END = re.compile(r"\r\n|\n|\r")
_OPENING = re.compile(r"\([^\s();]+(?:[ \t]+[^\s();]+)?")


@dataclass(frozen=True, eq=False)
class Source:
    """One PDDL file.

    Attributes:
        name: The file's path as the user wrote it; it opens every message.
        text: The whole content.
        warnings: Remarks on the file that are not errors, as `Place.warn` added it;
            `Domain.warnings` has each once.
        recovery: Takes the errors, and the parser goes on behind each; None raises the first.
    """

    name: str
    text: str
    warnings: list[DomainWarning] = field(default_factory=list, repr=False)
    recovery: Recovery | None = field(default=None, repr=False)

    @classmethod
    def read(cls, path: str | Path) -> Source:
        """Read a file.

        Raises:
            DomainError: The file is missing, unreadable, not a regular file (reading a pipe could
                block), or not UTF-8.
        """
        path, advice, most = Path(path), "", 1 << 28
        try:
            status = path.stat()
            if path.is_dir():
                reason = "it is a folder"
            elif not stat.S_ISREG(status.st_mode):
                reason = "it is not a regular file"
            elif status.st_size > most:
                reason = f"it has {status.st_size:,} bytes; the limit is {most:,} bytes"
            else:  # some editors put a byte order mark first; it is not part of the text
                return cls(str(path), path.read_bytes().decode("utf-8").removeprefix("\ufeff"))
            problem = f"{path}: cannot be read ({reason})"
        except FileNotFoundError:
            problem = f"{path}: there is no such file"
        except UnicodeDecodeError as error:
            problem = f"{path}: byte {error.start} is not valid UTF-8 text"
            advice = "save the file as UTF-8"
        except OSError as error:
            problem = f"{path}: cannot be read ({error.strerror})"
        except ValueError as error:  # no path of this system: a null character
            problem = f"{str(path)!r}: cannot be read ({error})"
        raise DomainError(problem, advice=advice, code="unreadable-file")

    def place(self, start: int, end: int) -> Place:
        """Return the place of the characters `start` to `end` (exclusive)."""
        return Place(self, start, end)

    def recovering(self, given_up: Place | None = None) -> _Recovering:
        """Leave the block at an error, which `recovery` takes, and go on behind it.

        Args:
            given_up: What the error keeps from being read; the names in it may be declared there,
                so that nobody is told that they are unknown.

        Raises:
            DomainError: The error, where there is no `recovery`.
        """
        return _Recovering(self.recovery, given_up)

    @property
    def errors_taken(self) -> int:
        """How many errors `recovery` took."""
        return self.recovery.taken if self.recovery is not None else 0

    @functools.cached_property
    def line_starts(self) -> list[int]:
        """Where each line begins; a line ends with a line feed, a carriage return, or both."""
        return [0, *(match.end() for match in _LINE_END.finditer(self.text))]

    def line_text(self, number: int) -> str:
        """Return a line, from 1, without its line break."""
        starts = self.line_starts
        end = starts[number] if number < len(starts) else len(self.text)
        return self.text[starts[number - 1] : end].rstrip("\r\n")


class Place(NamedTuple):
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

    def within(self, other: Place) -> bool:
        """Whether the place is a part of another one."""
        return self.source is other.source and other.start <= self.start <= self.end <= other.end

    @property
    def opening(self) -> Place:
        """Where a form says what it is: `(:action go` of all of an action."""
        head = _OPENING.match(self.source.text, self.start)
        return self if head is None else Place(self.source, self.start, min(head.end(), self.end))

    @property
    def source_line(self) -> str:
        """The whole line on which the place begins, without its line break."""
        return self.source.line_text(self.line)

    @property
    def first_line(self) -> Place:
        """The part of it on its first line, at least a character."""
        end = self.start + len(self.source_line) - (self.column - 1)
        end = min(self.end, end)
        return Place(self.source, self.start, min(max(end, self.start + 1), len(self.source.text)))

    def warn(
        self, text: str, code: str = "not-portable", *, write: str | None = None, advice: str = ""
    ) -> None:
        """Add a warning about this place to those of its file; see `DomainWarning`."""
        fix = None if write is None else Fix((Edit(self.start, self.end, write),))
        self.source.warnings.append(DomainWarning(text, self, code, advice, fix))

    def recovering(self) -> _Recovering:
        """Leave the block at an error in this place, and go on; see `Source.recovering`."""
        return self.source.recovering(self)

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
        code: What kind of remark it is (docs/reference/checks.md).
        advice: What to do about it; may be empty.
        fix: What to change, where that is known.
    """

    text: str
    place: Place | None = None
    code: str = ""
    advice: str = ""
    fix: Fix | None = None

    def __str__(self) -> str:
        return printable(self.text if self.place is None else f"{self.place}: {self.text}")


@dataclass
class Recovery:
    """Takes the errors of files, so that reading goes on behind each.

    Attributes:
        errors: In the order in which they are found.
        given_up: Words in what could not be read; a name among them is not reported as unknown.
        torn: Sections with a slip in their parentheses → whether another error in them is kept;
            more would only follow from the slip.
        taken: How many errors there were, with those that follow from others.
    """

    errors: list[DomainError] = field(default_factory=list)
    given_up: set[str] = field(default_factory=set)
    torn: dict[Place, bool] = field(default_factory=dict)
    taken: int = 0

    def take(self, error: DomainError, place: Place | None = None) -> None:
        """Keep an error, and give up what stands at a place."""
        self.taken += 1
        at = error.place
        torn = next((s for s in self.torn if at is not None and at.within(s)), None)
        follows = torn is not None and self.torn[torn]
        if at is not None and error.code == "unknown-name":
            follows = follows or at.text.lower() in self.given_up
        if torn is not None:
            self.torn[torn] = True
        if not follows:
            self.errors.append(error)
        if place is not None:
            self.give_up(place.source.text[place.start : place.end])

    def give_up(self, text: str) -> None:
        """Note that a text could not be read."""
        self.given_up.update(re.findall(r"[^\s();]+", text.lower()))


class _Recovering(NamedTuple):
    """The block of `Source.recovering`."""

    recovery: Recovery | None
    given_up: Place | None

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: object, trace: object) -> bool:
        if self.recovery is None or not isinstance(error, DomainError):
            return False
        self.recovery.take(error, self.given_up)
        return True


class DomainError(SerpError):
    """Something is wrong in a domain or problem file.

    Attributes:
        problem: What is wrong, one sentence.
        advice: What to do about it; may be empty.
        code: What kind of error it is (docs/reference/checks.md).
        fix: What to change, where that is known or can be guessed.
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
        guess: str | None = None,
        fix: Fix | None = None,
        code: str = "malformed",
    ) -> None:
        """Describe what is wrong: see the attributes.

        `write` is the text to write at the place, where that is known, and `guess` one that may
        have been meant; `fix` is for a change of other places.
        """
        self.code = code
        self.fix = fix
        meant = guess if write is None else write
        if place is not None and meant is not None:
            edit = Edit(place.start, place.end, meant)
            self.fix = Fix((edit,), sure=write is not None)
        self.problem = printable(problem)
        self.advice = printable(advice)
        self.place = place
        self.file = place.source.name if place else None
        self.line = place.line if place else None
        self.column = place.column if place else None
        self.source_line: str | None = None
        self.corrected_line = ""
        first, width, excerpt = self.problem, 0, None
        if place is not None:
            first, width = f"{printable(str(place))}: {self.problem}", place.end - place.start
            excerpt = Excerpt.of(place.line, place.source_line, place.column)
            self.source_line = excerpt.text
            if write is not None:
                corrected = Excerpt.of(place.line, place.replaced(write), place.column)
                self.corrected_line = corrected.text
        super().__init__(error_message(first, excerpt, width, self.advice, self.corrected_line))


_RULE: Final = re.compile(r"^[;\s]*[-=~*_#+]{3,}|[-=~*_#+]{3,}\s*$")
"""Marks of a line that is drawn through a file."""
_SILENCE: Final = re.compile(r"\bserp:[ \t]*ignore(-file)?(\[[^\]]*\])?")
"""What is said to `serp check`, not to people."""


def comment_of(place: Place) -> str:
    """Return the comment of a place in one line, without its semicolons; empty where none is.

    It stands behind the line, or in the lines right above, unless these are the head of a section.
    """
    code, mark, text = place.source_line.partition(";")
    if mark and code.strip():
        return _joined([text])
    if place.source_line[: place.column - 1].strip():
        return ""
    texts: list[str] = []
    for number in range(place.line - 1, 0, -1):
        code, mark, text = place.source.line_text(number).partition(";")
        if code.strip() or not mark:
            break
        texts.insert(0, text)
    return "" if any(map(_RULE.search, texts)) else _joined(texts)


def _joined(texts: list[str]) -> str:
    words = (_SILENCE.sub("", text).lstrip(";").split() for text in texts)
    return " ".join(map(" ".join, words)).strip()
