"""Which findings are worth an expert's time: one rule for what is shown and what is written."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final

from serp.diagnosis.accuracy import WELL, Quantity
from serp.diagnosis.findings import Findings, MissingEffect, ParameterFinding
from serp.sysid.effect_search import LASTING
from serp.sysid.lifted_features import WORLD

_CERTAIN: Final = 4.0
"""Standard errors: a file has many numbers, and hardly one is to be called wrong by chance."""
_CHANGE: Final = 1e-4
"""Of the squared change of what the finding is about: 1 % of the change."""
_LEFT: Final = 0.002
"""Of the squared error that is left when everything found is taken into account."""


def worthwhile(findings: Findings, explained: Sequence[Quantity], processes: set[str]) -> Findings:
    """Return the findings that are worth mentioning.

    They are certain, four standard errors, and make a difference: 1 % of the change of what they
    are about, or 0.3 % where it goes on whatever the action (it adds up, while what the actions do
    cancels out), and 0.2 % of the squared error that is left. Other outcomes by chance are worth
    mentioning; they are only found where they are frequent. Lines on the reward or the end are
    where the other findings do not explain it, and as far as they make a difference of 10 %.

    Args:
        findings: All findings.
        explained: How well everything is predicted with all of them taken into account.
        processes: Names of the processes of the file.
    """
    left = {quantity.name: quantity.squared_left for quantity in explained}
    unsettled = {quantity.name for quantity in explained if quantity.unexplained > WELL}

    def pays(finding: ParameterFinding | MissingEffect) -> bool:
        lasting = finding.schema == WORLD or finding.schema in processes
        rest = _LEFT * left.get(finding.fluent.split(" ")[0], 0.0)
        return finding.cost > max(LASTING if lasting else _CHANGE, rest)

    def certain(missing: MissingEffect) -> MissingEffect:
        terms = (term for term in missing.terms if abs(term.coefficient) > _CERTAIN * term.error)
        return dataclasses.replace(missing, terms=tuple(terms))

    return dataclasses.replace(
        findings,
        literals=tuple(f for f in findings.literals if differs(f, _CERTAIN) and pays(f)),
        missing=tuple(m for m in map(certain, findings.missing) if m.terms and pays(m)),
        rules=tuple(r for r in findings.rules if r.fluent in unsettled and r.cost > WELL**2),
    )


def without(findings: Findings, some: Findings) -> Findings:
    """Return the findings that are not among some others."""
    literals = {finding.parameter.index for finding in some.literals}
    missing = {(finding.schema, finding.fluent) for finding in some.missing}
    return dataclasses.replace(
        findings,
        literals=tuple(f for f in findings.literals if f.parameter.index not in literals),
        missing=tuple(f for f in findings.missing if (f.schema, f.fluent) not in missing),
        outcomes=tuple(f for f in findings.outcomes if f not in some.outcomes),
        rules=tuple(f for f in findings.rules if f not in some.rules),
    )


def differs(finding: ParameterFinding, errors: float) -> bool:
    """Whether a literal is so many standard errors from what was observed."""
    gap = abs(finding.estimate - finding.written)
    rounding = 1e-9 * max(abs(finding.estimate), abs(finding.written))
    return gap > max(errors * finding.error, rounding)
