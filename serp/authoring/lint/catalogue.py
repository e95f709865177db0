"""All rules that `serp check` asks of a domain, by the code of what they find."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType

from serp.authoring.lint import conditions as comparisons
from serp.authoring.lint import conditions as semantics
from serp.authoring.lint import declarations as omissions
from serp.authoring.lint import declarations as requirements
from serp.authoring.lint import declarations as unused
from serp.authoring.lint import effects
from serp.authoring.lint import effects as copies
from serp.authoring.lint import effects as dynamics
from serp.authoring.lint import effects as limits
from serp.authoring.lint.subject import LintSubject
from serp.model.domain import Domain
from serp.pddl.source import DomainWarning

LOCAL = frozenset(
    (
        *comparisons.RULES,
        *copies.RULES_OF_COPIES,
        *effects.RULES,
        *("contradictory-condition", "dead-effect", "flag-read-in-action", "unused-parameter"),
    )
)
"""Rules that look at one schema at a time, or two: what they say of one that can be read is right
where another cannot be read."""
_OF_A_WHOLE = ("nothing-unsafe", "no-reward", "schema-without-use", "never-read", "unused-type")
"""Rules that can tell nothing of a domain without the problem that it needs."""
RULES: Mapping[str, Callable[[LintSubject], Iterator[DomainWarning]]] = MappingProxyType(
    {
        **omissions.RULES_OF_OMISSIONS,
        **semantics.RULES_OF_SEMANTICS,
        **comparisons.RULES,
        **effects.RULES,
        **copies.RULES_OF_COPIES,
        **dynamics.RULES_OF_DYNAMICS,
        **limits.RULES_OF_LIMITS,
        **unused.RULES,
        **requirements.RULES_OF_REQUIREMENTS,
    }
)
"""Code → what yields its warnings."""


def warnings_of(domain: Domain, rules: Collection[str] | None = None) -> list[DomainWarning]:
    """Return what may have been forgotten or misspelt; none of it stops a training.

    Args:
        domain: Instantiated without errors.
        rules: The codes of the rules that are asked; None: all.
    """
    subject = LintSubject(domain)
    found = [*domain.warnings]
    for code, rule in RULES.items():
        if rules is None and code in _OF_A_WHOLE and subject.waits_for_problem:
            continue
        if rules is None or code in rules:
            found += (replace(warning, code=code) for warning in rule(subject))
    return found
