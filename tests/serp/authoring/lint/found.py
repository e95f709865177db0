"""The findings of a domain, as the tests look at them."""

from pathlib import Path

from serp.authoring.lint.findings import Finding, examine
from serp.pddl.source import Source


def findings_of(domain: Source | Path, problem: Source | None = None) -> list[Finding]:
    return examine(domain, problem).findings
