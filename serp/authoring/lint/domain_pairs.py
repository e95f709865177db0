"""Which of several files are a domain and its problem, by what is in them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from serp.errors import SerpError
from serp.pddl.reader import read_what_can_be
from serp.pddl.source import DomainError, Source

_TITLE = re.compile(r"\(\s*(domain|problem|:domain)\s+([^\s();]+)|;[^\r\n]*", re.IGNORECASE)
"""What a file is, and the domain of a problem; or a comment."""


class DomainFiles(NamedTuple):
    """One domain to check, by the name that was given.

    `domain` is None for an installed task, or where the file is not known; `problem` None for the
    one beside the domain file, if there is one.
    """

    name: str
    domain: Path | None
    problem: Path | None


def pairs(names: Iterable[str]) -> list[DomainFiles]:
    """Return the domains that files and names of tasks mean, each once, with their problems.

    A domain file is checked with each problem that belongs to it, and by itself (or with the
    problem beside it) where none is given.
    """
    from serp.tasks.registry import find_domain_file

    given = [(name, find_domain_file(name)) for name in names]
    titles = {path: _title_of_file(path) for _, path in given if path is not None}
    domains = [path for path, title in titles.items() if title.kind != "problem"]
    checks: dict[tuple[Path | str, Path | None], DomainFiles] = {}
    for name, path in given:
        domain, problem = path, None
        if path is not None and (title := titles[path]).kind == "problem":
            fitting = [known for known in domains if titles[known].domain == title.domain]
            if len(domains) == 1:  # names that differ are warned of
                fitting += domains
            domain, problem = next(iter(fitting), None) or domain_beside(path, title), path
        checks.setdefault((domain or name, problem), DomainFiles(name, domain, problem))
    with_problem = {domain for domain, problem in checks if problem}
    return [
        pair for (domain, problem), pair in checks.items() if problem or domain not in with_problem
    ]


class Title(NamedTuple):
    """`domain` or `problem` (empty where it is unknown), and the name of the domain."""

    kind: str
    domain: str


def _title_of_file(path: Path) -> Title:
    try:
        return title_of(Source.read(path))
    except SerpError:
        return Title("", "")


def title_of(source: Source) -> Title:
    """Return what a file is, as far as its first lines can be read."""
    named: dict[str, str] = {}
    for match in _TITLE.finditer(source.text):
        if match[1]:
            named.setdefault(match[1].lower(), match[2].lower())
            if "domain" in named or len(named) > 1:
                break
    kind = next((word for word in named if word != ":domain"), "")
    return Title(kind, named.get("domain" if kind == "domain" else ":domain", ""))


def domain_not_found(problem: Source) -> DomainError:
    """Return what is to be said of a problem file whose domain file is not known."""
    places = {group.head: group.place for group in read_what_can_be(problem)}
    named = places.get(":domain", places["problem"])
    return DomainError(
        "this is a problem file, but its domain file is not known",
        problem.place(named.start, named.end),
        f"give both, as in `serp check domain.pddl {problem.name}`",
        code="missing-domain",
    )


def domain_beside(problem: Path, title: Title) -> Path | None:
    """Return the domain file beside a problem file; None where there is none."""
    names = (problem.stem.removesuffix("-problem"), title.domain, "domain")
    files = (problem.with_name(f"{name}.pddl") for name in names if name and name != problem.stem)
    return next((file for file in files if file.is_file()), None)
