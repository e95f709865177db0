"""All findings about a domain and its problem, in one pass, and the comments that silence them."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from serp._util.text import closest
from serp.authoring.lint.catalogue import warnings_of
from serp.authoring.lint.codes import CODES, ERRORS, NOTES
from serp.authoring.lint.portability import beyond_pddl, one_per_rule, outside_portable_subset
from serp.authoring.lint.subject import MOST_INSTANCES
from serp.model.domain import Domain, problem_beside
from serp.pddl.parser import parse_domain, parse_problem
from serp.pddl.source import (
    DomainError,
    DomainWarning,
    Edit,
    Fix,
    Place,
    Recovery,
    Source,
    line_end,
    line_start,
)

_COMMENT = re.compile(r";[^\r\n]*?\bserp:[ \t]*(ignore(?:-file)?)\b(?:\[([^\]\r\n]*)\])?")
_CODE = re.compile(r"[^\s,]+")
_BLANK_OR_COMMENT = re.compile(r"\s*(;.*)?\Z")


def silenced(
    warnings: Iterable[DomainWarning], sources: Iterable[Source], *, partial: bool
) -> Iterator[DomainWarning]:
    """Yield the warnings that no comment silences, and warnings of comments that silence nothing.

    With `partial`, some rules were not applied, so that unused comments are no mistake.
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
        if comment.code not in CODES or not (comment.used or partial):
            yield comment.warning()


@dataclass
class _Silence:
    """One code in one comment; `line` is None for all of the file, `comment` what to leave out."""

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

    def warning(self) -> DomainWarning:
        """Return the warning that the comment silences nothing."""
        advice, fix = "write the code of a warning in brackets", None
        if self.code in CODES:
            kind = (
                "an error, which no comment silences" if self.code in ERRORS else "not found here"
            )
            text = f"`{self.code}` is {kind}; this comment silences nothing"
            advice = "leave the comment out"
            if self.comment[0] < self.comment[1]:
                fix = Fix((Edit(*self.comment, ""),))
        else:
            problem = f"there is no code `{self.code}`" if self.code else "no code in brackets"
            text = f"{problem}; nothing is silenced"
            if close := closest(self.code, CODES):
                advice = f"did you mean `{close}`?"
                fix = Fix((Edit(self.place.start, self.place.end, close),), sure=False)
        return DomainWarning(text, self.place, "useless-silence", advice, fix)


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


Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """An error, a warning or a note about a place in the files.

    Attributes:
        code: One of `CODES`.
        severity: `error` where the files cannot be used as they are, `note` where it is right for
            many files.
        message: One sentence.
        advice: What to write instead; may be empty.
        place: None where a file as a whole is meant, or cannot be read.
        fix: The correction, where it is known or can be guessed.
        rendered: The finding as `serp check` prints it.
    """

    code: str
    severity: Severity
    message: str
    advice: str
    place: Place | None
    fix: Fix | None
    rendered: str

    @classmethod
    def of(cls, problem: DomainError | DomainWarning) -> Finding:
        """Return the finding of an error or a warning."""
        code, place, advice, fix = problem.code, problem.place, problem.advice, problem.fix
        if isinstance(problem, DomainError):
            first, newline, rest = str(problem).partition("\n")
            text = f"{first} [{code}]{newline}{rest}"
            return cls(code, "error", problem.problem, advice, place, fix, text)
        severity: Severity = "note" if code in NOTES else "warning"
        text = f"{problem}{f'; {advice}' if advice else ''} [{code}]"
        return cls(code, severity, problem.text, advice, place, fix, text)

    def as_dict(self) -> dict[str, Any]:
        """Return the finding as JSON values; lines and columns count from 1, ends are exclusive."""
        place = None
        if self.place is not None:
            place = {**spot(self.place), "file": self.place.source.name}
        fix = None
        if self.fix is not None and self.place is not None:
            source = self.place.source
            fix = {
                "sure": self.fix.sure,
                "edits": [
                    {**spot(source.place(e.start, e.end)), "text": e.text} for e in self.fix.edits
                ],
            }
        texts = {k: getattr(self, k) for k in ("code", "severity", "message", "advice")}
        return {**texts, "place": place, "fix": fix}


def spot(place: Place) -> dict[str, int]:
    """Return line, column, and the end of a place, from 1; the end is exclusive."""
    end = Place(place.source, place.end, place.end)
    return {
        "line": place.line,
        "column": place.column,
        "end_line": end.line,
        "end_column": end.column,
    }


@dataclass(frozen=True)
class Examined:
    """The findings of a domain and its problem, in the order of the files and places.

    `domain` is None where one of them is an error.
    """

    findings: list[Finding]
    domain: Domain | None


def findings_of(
    domain: Source | str | Path, problem: Source | str | Path | None = None
) -> list[Finding]:
    """Return all findings of a domain; see `examine`."""
    return examine(domain, problem).findings


def examine(
    domain: Source | str | Path,
    problem: Source | str | Path | None = None,
    *,
    max_ground_schemas: int | None = None,
    portable: bool = False,
    look: Callable[[Domain], Iterable[DomainWarning]] | None = None,
) -> Examined:
    """Return the findings of a domain; nothing in the files raises an error.

    Args:
        domain: The domain file, or its text.
        problem: The problem file, or its text; None for the one beside the domain file, if there is
            one. Beside a text there is none.
        max_ground_schemas: Most ground actions, processes and events together; None: 50,000.
        portable: Whether functions that no other PDDL tool knows are findings.
        look: Returns further warnings of a domain without errors.

    Raises:
        SerpError: `look` raised it.
    """
    recovery = Recovery()
    sources, unreadable = _read(domain, problem, recovery)
    problems: list[DomainError | DomainWarning] = [*unreadable]
    result: Domain | None = None
    if sources:
        result = _parse(sources, recovery, max_ground_schemas)
        errors = [*unreadable, *recovery.errors]
        warnings = [*_warnings(result, sources, partial=bool(errors), portable=portable)]
        if look is not None and result is not None and not errors:
            warnings += [_moved(warning, sources) for warning in look(result)]
        unsilenced = silenced(warnings, sources, partial=bool(errors))
        problems = [*_unsupported_once(errors), *one_per_rule(unsilenced)]
    order = {source.name: number for number, source in enumerate(sources)}

    def position(finding: Finding) -> tuple[int, int]:
        place = finding.place
        return (order.get(place.source.name, -1), place.start) if place is not None else (-1, 0)

    findings = sorted((Finding.of(one) for one in dict.fromkeys(problems)), key=position)
    wrong = any(finding.severity == "error" for finding in findings)
    return Examined(findings, None if wrong else result)


def _unsupported_once(errors: Iterable[DomainError]) -> Iterator[DomainError]:
    """Yield errors; one for all places of a file with the same unsupported form, at the first."""
    places: dict[tuple[object, ...], list[DomainError]] = {}
    for number, error in enumerate(errors):
        file = error.file if error.code == "unsupported" and error.place else number
        places.setdefault((error.problem, file), []).append(error)
    for first, *others in places.values():
        if others:
            text = f"{first.problem} ({1 + len(others)} places)"
            first = DomainError(text, first.place, first.advice, code=first.code)
        yield first


def _read(
    domain: Source | str | Path, problem: Source | str | Path | None, recovery: Recovery
) -> tuple[list[Source], list[DomainError]]:
    """Return the files that can be read, the domain first (none without it), and the errors."""
    if problem is None and not isinstance(domain, Source):
        beside = problem_beside(Path(domain))
        problem = beside if beside.is_file() else None
    sources: list[Source] = []
    try:
        for given in (domain, problem):
            if given is not None:
                read = given if isinstance(given, Source) else Source.read(given)
                sources.append(Source(read.name, read.text, recovery=recovery))
    except DomainError as error:
        return sources, [error]
    return sources, []


def _parse(sources: list[Source], recovery: Recovery, limit: int | None) -> Domain | None:
    """Return what can be understood of the files, instantiated; None where nothing can."""
    try:
        syntax = parse_domain(sources[0])
        problem = parse_problem(sources[1], syntax) if len(sources) > 1 else None
    except DomainError as error:
        recovery.take(error)
        return None
    domain = Domain(sources[0], sources[1] if len(sources) > 1 else None, syntax, problem)
    if limit is not None:
        domain = dataclasses.replace(domain, max_ground_schemas=limit)
    if recovery.errors:  # it is instantiated for what the rules find in single schemas
        most = min(MOST_INSTANCES, domain.max_ground_schemas)
        domain = dataclasses.replace(domain, max_ground_schemas=most)
    try:
        domain.model  # noqa: B018  (instantiated now, for the errors that only this finds)
    except DomainError as error:
        if not recovery.errors:  # otherwise something may be missing that was not read
            recovery.take(error)
        return None
    return domain


def _warnings(
    domain: Domain | None, sources: list[Source], *, partial: bool, portable: bool
) -> Iterator[DomainWarning]:
    if domain is not None:
        yield from warnings_of(domain, partial=partial)
    else:
        for source in sources:
            yield from source.warnings
    for source in sources:
        if not partial:
            yield from outside_portable_subset(source)
        if portable and domain is not None:
            yield from beyond_pddl(source, domain.syntax.declarations)


def _moved(warning: DomainWarning, sources: list[Source]) -> DomainWarning:
    """Return a warning that points into these sources; it was found in others of the same text."""
    place = warning.place
    for source in sources if place is not None else ():
        if place is not None and source.name == place.source.name:
            return dataclasses.replace(warning, place=source.place(place.start, place.end))
    return warning
