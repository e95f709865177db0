"""Everything that is wrong or doubtful in a domain and its problem, in one pass."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from serp.lint.codes import NOTES
from serp.lint.portability import beyond_pddl, one_per_rule, outside_portable_subset
from serp.lint.rules.catalogue import LOCAL, warnings_of
from serp.lint.silencing import silenced
from serp.lint.subject import MOST_INSTANCES
from serp.model.loading import Domain, problem_beside
from serp.pddl.domain_parser import parse_domain
from serp.pddl.edits import Fix
from serp.pddl.problem_parser import parse_problem
from serp.pddl.source import DomainError, DomainWarning, Place, Recovery, Source

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong or doubtful.

    Attributes:
        code: What kind of thing; docs/reference/checks.md has all.
        severity: `error` where the files cannot be used as they are, `note` where it is right for
            many files.
        message: What, one sentence.
        advice: What to do about it; may be empty.
        place: Where; None where a file as a whole is meant, or cannot be read.
        fix: What to change, where that is known or can be guessed.
        rendered: The finding as the command prints it.
    """

    code: str
    severity: Severity
    message: str
    advice: str
    place: Place | None
    fix: Fix | None
    rendered: str

    @classmethod
    def of(cls, found: DomainError | DomainWarning) -> Finding:
        """Return what an error or a warning tells."""
        if isinstance(found, DomainError):
            return cls(
                found.code,
                "error",
                found.problem,
                found.advice,
                found.place,
                found.fix,
                f"{found} [{found.code}]" if "\n" not in str(found) else _coded(found),
            )
        return cls(
            found.code,
            "note" if found.code in NOTES else "warning",
            found.text,
            found.advice,
            found.place,
            found.fix,
            f"{found}{f'; {found.advice}' if found.advice else ''} [{found.code}]",
        )

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
        told = {k: getattr(self, k) for k in ("code", "severity", "message", "advice")}
        return {**told, "place": place, "fix": fix}


def _coded(error: DomainError) -> str:
    first, rest = str(error).split("\n", 1)
    return f"{first} [{error.code}]\n{rest}"


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
    """What was found in a domain and its problem.

    Attributes:
        findings: In the order of files and places.
        domain: The domain where nothing is wrong with it; None otherwise.
    """

    findings: list[Finding]
    domain: Domain | None


def findings_of(
    domain: Source | str | Path,
    problem: Source | str | Path | None = None,
    *,
    max_ground_schemas: int | None = None,
    portable: bool = False,
) -> list[Finding]:
    """Return all that is to be said of a domain; it never raises for what the files say.

    Args:
        domain: The domain file, or its text.
        problem: The problem file, or its text; None for the one beside the domain file, if there is
            one. Beside a text there is none.
        max_ground_schemas: Most ground actions, processes and events together; None: 50,000.
        portable: Whether functions that no other PDDL tool knows are named.
    """
    limit = max_ground_schemas
    return examine(domain, problem, max_ground_schemas=limit, portable=portable).findings


def examine(
    domain: Source | str | Path,
    problem: Source | str | Path | None = None,
    *,
    max_ground_schemas: int | None = None,
    portable: bool = False,
    look: Callable[[Domain], Iterable[DomainWarning]] | None = None,
) -> Examined:
    """Return the findings, and the domain where none is an error; see `findings_of`.

    Args:
        domain: See `findings_of`.
        problem: See `findings_of`.
        max_ground_schemas: See `findings_of`.
        portable: See `findings_of`.
        look: Returns what else there is to say of a domain without errors.

    Raises:
        SerpError: `look` raised it.
    """
    recovery = Recovery()
    sources, unreadable = _read(domain, problem, recovery)
    found: list[DomainError | DomainWarning] = [*unreadable]
    result: Domain | None = None
    if sources:
        result = _parse(sources, recovery, max_ground_schemas)
        errors = [*unreadable, *recovery.errors]
        warnings = [*_warnings(result, sources, partial=bool(errors), portable=portable)]
        if look is not None and result is not None and not errors:
            warnings += [_moved(warning, sources) for warning in look(result)]
        kept = silenced(warnings, sources, partial=bool(errors))
        found = [*_unsupported_once(errors), *one_per_rule(kept)]
    order = {source.name: number for number, source in enumerate(sources)}

    def position(finding: Finding) -> tuple[int, int]:
        place = finding.place
        return (order.get(place.source.name, -1), place.start) if place is not None else (-1, 0)

    findings = sorted((Finding.of(one) for one in dict.fromkeys(found)), key=position)
    wrong = any(finding.severity == "error" for finding in findings)
    return Examined(findings, None if wrong else result)


def _unsupported_once(errors: Iterable[DomainError]) -> list[DomainError]:
    """Return errors with what is not supported, at several places of a file, told at the first."""
    places: dict[tuple[str, str], list[DomainError]] = {}
    for number, error in enumerate(errors):
        file = error.file if error.code == "unsupported" and error.place else number
        places.setdefault((error.problem, str(file)), []).append(error)
    return [
        error[0]
        if len(error) == 1
        else DomainError(
            f"{error[0].problem} ({len(error)} places)",
            error[0].place,
            error[0].advice,
            code=error[0].code,
        )
        for error in places.values()
    ]


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
        yield from warnings_of(domain, LOCAL if partial else None)
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
