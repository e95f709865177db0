"""All rules that `serp check` applies to a domain, by the code of their warnings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from serp.authoring.lint import conditions, declarations, effects
from serp.authoring.lint.subject import LintSubject
from serp.model.domain import Domain
from serp.pddl.source import DomainWarning

RULES: dict[str, Callable[[LintSubject], Iterator[DomainWarning]]] = {
    **declarations.RULES,
    **conditions.RULES,
    **effects.RULES,
}
"""Code → the function that yields its warnings."""
_LOCAL = frozenset(
    (
        *("always-true", "assigned-twice", "contradictory-condition", "dead-effect"),
        *("double-negative", "flag-read-in-action", "no-change", "same-schema"),
        *("set-and-unset", "unused-parameter"),
    )
)
"""Rules about single actions, processes and events; they are right though others are unreadable."""
_NEEDS_PROBLEM = frozenset(["nothing-unsafe", "no-reward", "schema-without-use", "never-read"])
"""Rules that say nothing of a domain without the problem that names its objects."""


def warnings_of(domain: Domain, *, partial: bool = False) -> list[DomainWarning]:
    """Return what may have been forgotten or misspelt in a domain; none of it stops a training.

    Args:
        domain: The domain, instantiated.
        partial: Whether parts of the files could not be read; only rules about single actions,
            processes and events apply then.
    """
    subject = LintSubject(domain)
    warnings = [*domain.warnings]
    for code, rule in RULES.items():
        skipped = (
            code not in _LOCAL if partial else subject.waits_for_problem and code in _NEEDS_PROBLEM
        )
        if not skipped:
            warnings += (replace(warning, code=code) for warning in rule(subject))
    return warnings
