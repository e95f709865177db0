"""All rules that `serp check` asks of a domain, by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType

from serp.lint import omissions, requirements, semantics, unused
from serp.lint.subject import LintSubject
from serp.model.loading import Domain
from serp.pddl.source import DomainWarning

RULES: Mapping[str, Callable[[LintSubject], Iterator[DomainWarning]]] = MappingProxyType(
    {**omissions.RULES, **semantics.RULES, **unused.RULES, **requirements.RULES}
)
"""Name of a rule → what yields its warnings, in the order in which they are printed."""


def warnings_of(domain: Domain) -> list[DomainWarning]:
    """Return what may have been forgotten or misspelt; none of it stops a training."""
    subject = LintSubject(domain)
    return [*domain.warnings, *(found for rule in RULES.values() for found in rule(subject))]
