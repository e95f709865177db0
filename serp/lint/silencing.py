"""Comments that silence a warning: `; serp: ignore[code]` and `; serp: ignore-file[code]`.

The first speaks of its own line or, where nothing stands before it, of the next line that is not a
comment. Several codes are separated by commas. Errors cannot be silenced.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from serp._util.text import closest
from serp.lint.codes import CODES
from serp.pddl.edits import Edit, Fix, line_end, line_start
from serp.pddl.source import DomainWarning, Place, Source

_COMMENT = re.compile(r";[^\r\n]*?\bserp:[ \t]*(ignore(?:-file)?)\b(?:\[([^\]\r\n]*)\])?")
_CODE = re.compile(r"[^\s,]+")
_BLANK_OR_COMMENT = re.compile(r"\s*(;.*)?\Z")


def silenced(
    warnings: Iterable[DomainWarning], sources: Iterable[Source], *, partial: bool
) -> Iterator[DomainWarning]:
    """Yield the warnings that no comment silences, and comments that silence nothing.

    Args:
        warnings: Of these files.
        sources: The files.
        partial: Whether errors kept some rules from being asked, so that it is not known what a
            comment would silence.
    """
    sources = list(sources)
    comments = [comment for source in sources for comment in _comments(source)]
    for warning in warnings:
        matching = [comment for comment in comments if comment.silences(warning, sources[0])]
        for comment in matching:
            comment.used = True
        if not matching:
            yield warning
    for comment in comments:
        if comment.code not in CODES:
            yield comment.unknown()
        elif not comment.used and not partial:
            yield comment.useless()


@dataclass
class _Silence:
    """One code in one comment; `line` is None for all of the file."""

    code: str
    place: Place
    line: int | None
    comment: tuple[int, int]
    used: bool = field(default=False)

    def silences(self, warning: DomainWarning, domain: Source) -> bool:
        place, source = warning.place, self.place.source
        if warning.code != self.code or source is not (place.source if place else domain):
            return False
        return self.line is None or (place is not None and place.line == self.line)

    def useless(self) -> DomainWarning:
        kind = "an error, which nothing silences" if CODES[self.code].error else "not found here"
        text = f"`{self.code}` is {kind}; this comment silences nothing"
        fix = Fix((Edit(*self.comment, ""),)) if self.comment[0] < self.comment[1] else None
        return DomainWarning(text, self.place, "useless-silence", "leave the comment out", fix)

    def unknown(self) -> DomainWarning:
        close = closest(self.code, CODES)
        advice = f"did you mean `{close}`?" if close else "write the code of a warning in brackets"
        fix = None
        if close:
            fix = Fix((Edit(self.place.start, self.place.end, close),), sure=False)
        text = f"there is no code `{self.code}`" if self.code else "no code in brackets"
        return DomainWarning(f"{text}; nothing is silenced", self.place, "useless-silence",
                             advice, fix)  # fmt: skip


def _comments(source: Source) -> Iterator[_Silence]:
    for match in _COMMENT.finditer(source.text):
        place = source.place(match.start(1), match.end())
        line: int | None = None
        if match[1] == "ignore":
            line = place.line if _after_text(source, match.start()) else _next_line(source, place)
        codes = list(_CODE.finditer(match[2] or ""))
        whole = _whole(source.text, match.start()) if len(codes) == 1 else (0, 0)
        for code in codes:
            start = match.start(2) + code.start()
            here = source.place(start, start + len(code[0]))
            yield _Silence(code[0], here, line, whole)
        if not codes:
            yield _Silence("", place, line, (0, 0))


def _after_text(source: Source, position: int) -> bool:
    return bool(source.text[line_start(source.text, position) : position].strip())


def _next_line(source: Source, place: Place) -> int:
    """Return the next line with something other than a comment."""
    lines = range(place.line + 1, len(source.line_starts) + 1)
    code = (n for n in lines if not _BLANK_OR_COMMENT.match(source.line_text(n)))
    return next(code, place.line)


def _whole(text: str, position: int) -> tuple[int, int]:
    """Return where a comment begins and ends, with the blanks before it, or its whole line."""
    start, end = line_start(text, position), line_end(text, position)
    before = text[start:position]
    if before.strip():
        return start + len(before.rstrip()), end
    after = text[end : end + 2]
    return start, end + (2 if after == "\r\n" else len(after[:1]))
