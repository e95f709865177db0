"""The files that an editor has open, and those that belong to them."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from serp.errors import SerpError
from serp.lint.domain_pairs import domain_beside, domain_not_found, title_of
from serp.lint.findings import Examined, Finding, examine
from serp.model.loading import Domain, problem_beside
from serp.pddl.source import Recovery, Source
from serp.scenarios.line import SUFFIX


class OpenPair(NamedTuple):
    """A domain, and a problem of it; either may be unknown.

    Attributes:
        asked: The file that was asked for: one of the two, or scenarios of the domain.
        domain: None for a problem or scenarios whose domain is not found.
        problem: None where there is none.
    """

    asked: Source
    domain: Source | None
    problem: Source | None

    @property
    def sources(self) -> tuple[Source, ...]:
        """The files of PDDL that are known."""
        return tuple(source for source in (self.domain, self.problem) if source is not None)


@functools.lru_cache(maxsize=16)
def text_of(name: str, text: str) -> Source:
    """Return a file with a text; the same one for the same text, which caches rely on."""
    return Source(name, text)


def pair_of(asked: Source, opened: Callable[[Path], str | None]) -> OpenPair:
    """Return a file with the one that belongs to it.

    Args:
        asked: A domain, a problem, or scenarios; its name is its path.
        opened: Path → its text in the editor; None where it is not open there.
    """

    def read(path: Path | None) -> Source | None:
        if path is None:
            return None
        text = opened(path)
        try:
            return text_of(str(path), Source.read(path).text if text is None else text)
        except SerpError:
            return None

    path = Path(asked.name)
    if path.suffix == SUFFIX:
        domain = path.with_suffix(".pddl")
        return OpenPair(asked, read(domain), read(problem_beside(domain)))
    title = title_of(asked)
    if title.kind == "problem":
        return OpenPair(asked, read(domain_beside(path, title)), asked)
    return OpenPair(asked, asked, read(problem_beside(path)))


def findings_in(pair: OpenPair) -> dict[str, list[Finding]]:
    """Return the name of each file → its findings: of both files of a pair, or of scenarios."""
    scenarios = pair.asked not in pair.sources
    if pair.domain is None:
        # Of scenarios there is nothing to be said without a domain.
        missing = [] if scenarios else [Finding.of(domain_not_found(pair.asked))]
        return {pair.asked.name: missing}
    found = _examined(pair.domain, pair.problem)
    if scenarios:
        return {pair.asked.name: _of_scenarios(pair.asked, found.domain)}
    return {
        source.name: [
            finding
            for finding in found.findings
            if (finding.place.source.name if finding.place else pair.domain.name) == source.name
        ]
        for source in pair.sources
    }


@functools.lru_cache(maxsize=4)
def _examined(domain: Source, problem: Source | None) -> Examined:
    return examine(domain, problem)


def _of_scenarios(source: Source, domain: Domain | None) -> list[Finding]:
    """Return what cannot be read in scenarios; nothing while the domain is wrong."""
    from serp.scenarios.reading import observed_in, read_scenarios  # takes a second to import

    if domain is None:
        return []
    recovery = Recovery()
    observed = observed_in(source, domain)
    read_scenarios(Source(source.name, source.text, recovery=recovery), observed, observed.model)
    return [Finding.of(error) for error in recovery.errors]
