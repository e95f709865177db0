"""Rules about the instances of a domain: what never or always happens."""

from __future__ import annotations

from collections.abc import Iterator

from serp.authoring.lint.subject import LintSubject, rule
from serp.pddl.source import DomainWarning


@rule("no-reward", needs_problem=True)
def _no_reward(subject: LintSubject) -> Iterator[DomainWarning]:
    if not subject.domain.model.rewarding:
        text = "nothing changes `(reward)`, so the planner has no reason to prefer an action"
        yield DomainWarning(text, subject.domain.syntax.place.opening)
