"""All findings about a domain and its problem, in one pass, and the comments that silence them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from serp.agent.causes import location_of
from serp.authoring.lint import rules
from serp.authoring.lint.subject import MOST_INSTANCES, LintSubject, Rule
from serp.model.domain import Domain, problem_beside
from serp.model.reachability import MAX_GROUND_SCHEMAS
from serp.pddl.parser import parse_domain, parse_problem
from serp.pddl.source import DomainError, DomainWarning, Fix, Place, Recovery, Source

RULES = [rule for rule in vars(rules).values() if isinstance(rule, Rule)]
NOTES = frozenset(("not-portable",))
"""Codes that are true of many a file which is as it should be."""
_COMMENT = re.compile(r";[^\r\n]*?\bserp:[ \t]*ignore(-file)?\[([^\]\r\n]*)\]")


def _unsilenced(
    warnings: Iterable[DomainWarning], sources: Sequence[Source]
) -> Iterator[DomainWarning]:
    """Yield the warnings that no comment silences: in the file, on its line or on the next one."""
    silent = set()
    for source in sources:
        for match in _COMMENT.finditer(source.text):
            line = source.place(match.start(), match.end()).line
            alone = not source.line_text(line).partition(";")[0].strip()
            of = None if match[1] else line + alone
            silent |= {(source.name, code, of) for code in re.findall(r"[\w-]+", match[2])}
    for warning in warnings:
        place = warning.place
        file = place.source.name if place is not None else sources[0].name
        lines = {None} if place is None else {None, place.line}
        if not silent & {(file, warning.code, line) for line in lines}:
            yield warning


Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """An error, a warning or a note about a place in the files.

    Attributes:
        code: docs/reference/checks.md has the meaning of each, and an example.
        severity: `error` where the files cannot be used as they are, `note` where it is right for
            many files.
        advice: What to write instead; may be empty.
        place: None where a file as a whole is meant, or cannot be read.
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
            place = asdict(location_of(self.place))
        fix = None
        if self.fix is not None and self.place is not None:
            source = self.place.source
            fix = {
                "sure": self.fix.sure,
                "edits": [
                    {**asdict(location_of(source.place(e.start, e.end))), "text": e.text}
                    for e in self.fix.edits
                ],
            }
        texts = {k: getattr(self, k) for k in ("code", "severity", "message", "advice")}
        return {**texts, "place": place, "fix": fix}


@dataclass(frozen=True)
class Examined:
    """The findings of a domain and its problem, in the order of the files and places.

    `domain` is None where one of them is an error.
    """

    findings: list[Finding]
    domain: Domain | None


def examine(
    domain: Source | str | Path,
    problem: Source | str | Path | None = None,
    *,
    look: Callable[[Domain], Iterable[DomainWarning]] | None = None,
    observed: bool = False,
) -> Examined:
    """Return the findings of a domain; nothing in the files raises an error.

    Files are given by path or as sources; of a path the problem is by default the one beside it.
    `look` returns further warnings of a domain without errors. `observed`: an environment gives
    the initial state, as in `Domain.observed`.
    """
    recovery = Recovery()
    sources = _read(domain, problem, recovery)
    result = _parse(sources, recovery, observed=observed) if sources else None
    warnings = [warning for source in sources for warning in source.warnings]
    if result is not None:  # of files that are read in part, local rules apply alone
        subject, partial = LintSubject(result), bool(recovery.errors)
        for rule in RULES:
            warnings += rule.applied(subject, partial=partial)
        warnings += look(result) if look is not None and not partial else ()
    problems = _once([*recovery.errors, *_unsilenced(warnings, sources)])
    order = {source.name: number for number, source in enumerate(sources)}

    def position(finding: Finding) -> tuple[int, int]:
        place = finding.place
        return (order.get(place.source.name, -1), place.start) if place is not None else (-1, 0)

    findings = sorted(map(Finding.of, problems), key=position)
    wrong = any(finding.severity == "error" for finding in findings)
    return Examined(findings, None if wrong else result)


def _once(problems: Iterable[DomainError | DomainWarning]) -> Iterator[DomainError | DomainWarning]:
    """Yield errors or warnings; of a form that may be everywhere, one for a message and a file."""
    seen = set()
    for problem in dict.fromkeys(problems):
        text = problem.problem if isinstance(problem, DomainError) else problem.text
        key = (text, problem.place.source if problem.place is not None else None)
        if key not in seen or problem.code not in ("unsupported", "not-portable"):
            yield problem
        seen.add(key)


def _read(
    domain: Source | str | Path, problem: Source | str | Path | None, recovery: Recovery
) -> list[Source]:
    """Return the files that can be read, the domain first; none without it."""
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
        recovery.take(error)
    return sources


def _parse(sources: list[Source], recovery: Recovery, *, observed: bool) -> Domain | None:
    """Return what can be understood of the files, instantiated; None where nothing can."""
    try:
        syntax = parse_domain(sources[0])
        problem = parse_problem(sources[1], syntax) if len(sources) > 1 else None
    except DomainError as error:
        recovery.take(error)
        return None
    # With errors it is instantiated for what the rules find in single schemas.
    most = MOST_INSTANCES if recovery.errors else MAX_GROUND_SCHEMAS
    domain = Domain(sources[0], sources[1] if problem else None, syntax, problem, most)
    domain = domain.observed() if observed else domain
    try:
        domain.model  # noqa: B018  (instantiated now, for the errors that only this finds)
    except DomainError as error:
        if not recovery.errors:  # otherwise something may be missing that was not read
            recovery.take(error)
        return None
    return domain
