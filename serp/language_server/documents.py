"""The files that an editor has open, and those that belong to them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from serp.errors import SerpError
from serp.lint.domain_pairs import domain_beside, domain_not_found, title_of
from serp.lint.findings import Finding, findings_of
from serp.model.loading import problem_beside
from serp.pddl.source import Source


class OpenPair(NamedTuple):
    """A domain, and a problem of it; either may be unknown.

    Attributes:
        asked: The file that was asked for, one of the two.
        domain: None for a problem whose domain is not found.
        problem: None where there is none.
    """

    asked: Source
    domain: Source | None
    problem: Source | None

    @property
    def sources(self) -> tuple[Source, ...]:
        """The files that are known."""
        return tuple(source for source in (self.domain, self.problem) if source is not None)


def pair_of(asked: Source, opened: Callable[[Path], str | None]) -> OpenPair:
    """Return a file with the one that belongs to it.

    Args:
        asked: A domain or a problem; its name is its path.
        opened: Path → its text in the editor; None where it is not open there.
    """

    def read(path: Path | None) -> Source | None:
        if path is None:
            return None
        text = opened(path)
        try:
            return Source.read(path) if text is None else Source(str(path), text)
        except SerpError:
            return None

    title, path = title_of(asked), Path(asked.name)
    if title.kind == "problem":
        return OpenPair(asked, read(domain_beside(path, title)), asked)
    return OpenPair(asked, asked, read(problem_beside(path)))


def findings_in(pair: OpenPair) -> dict[str, list[Finding]]:
    """Return the name of each file of a pair → its findings; for a problem, those of it alone."""
    if pair.domain is None:
        return {pair.asked.name: [Finding.of(domain_not_found(pair.asked))]}
    findings = findings_of(pair.domain, pair.problem)
    names = [pair.asked.name] if pair.asked is pair.problem else [s.name for s in pair.sources]
    return {
        name: [f for f in findings if (f.place.source.name if f.place else names[0]) == name]
        for name in names
    }
