"""A version of the files, read: what is wrong in it, and the planner that it gives."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from serp.authoring.lint.findings import Finding, examine
from serp.model.domain import Domain
from serp.model.transition_model import TransitionModel
from serp.pddl.source import DomainError, Source
from serp.planning.replanner import MonitorReplanner
from serp.settings import PlannerSettings

_SECONDS: Final = 2.0
"""Most time of one lookahead."""
_KEPT: Final = 2
"""Readings that are kept: of the text, while its states change, and of what it is compared with."""


class Version(NamedTuple):
    """The texts of a domain and its problem.

    Attributes:
        domain_name, problem_name: The files, as messages call them.
        domain, problem: Their texts; `problem` is None where there is none.
    """

    domain_name: str
    domain: str
    problem_name: str
    problem: str | None

    def sources(self) -> tuple[Source, Source | None]:
        """Return the domain and the problem as sources."""
        problem = None if self.problem is None else Source(self.problem_name, self.problem)
        return Source(self.domain_name, self.domain), problem


@dataclass(frozen=True)
class Surroundings:
    """What a file is read for, beside its own text.

    Attributes:
        dt: Control period.
        planner: Settings of the lookahead.
        observed: Whether any state can be looked at, or only what is reached from `:init`.
        supplied: Names of the fluents that are observed.
    """

    dt: float = 1.0
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    observed: bool = True
    supplied: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Reading:
    """What came of reading a version.

    Attributes:
        findings: What is wrong or doubtful.
        planner: Its planner; None where an error leaves no model.
    """

    findings: tuple[Finding, ...]
    planner: MonitorReplanner | None


@functools.lru_cache(_KEPT)
def read(version: Version, surroundings: Surroundings) -> Reading:
    """Read a version; whatever is wrong in it becomes findings.

    Raises:
        SerpError: The planner cannot be made.
    """
    examined = examine(*version.sources())
    findings = tuple(examined.findings)
    if examined.domain is None:
        return Reading(findings, None)
    domain = _for_any_state(examined.domain, surroundings)
    # As bytecode: a keystroke waits for no compiler.
    model = TransitionModel(domain.model.ground, dt=surroundings.dt, own_code=False)
    return Reading(findings, planner_of(model, surroundings.planner))


def planner_of(model: TransitionModel, settings: PlannerSettings) -> MonitorReplanner:
    """Return the lookahead of a model."""
    return MonitorReplanner.of(model, settings, time_budget=_SECONDS)


def _for_any_state(domain: Domain, surroundings: Surroundings) -> Domain:
    """Return a domain for states that need not be reached from `:init`, unless it is too large."""
    if not surroundings.observed:
        return domain
    try:
        observed = domain.observed(surroundings.supplied)
        observed.model  # noqa: B018  (instantiated now)
    except DomainError:
        return domain  # its model says what is wrong, if anything is
    return observed
