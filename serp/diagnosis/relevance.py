"""The rule for findings that are worth mentioning; shared by `diagnose` and `repair`."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final

from serp.diagnosis.accuracy import WELL, Quantity
from serp.diagnosis.findings import Findings, MissingEffect, ParameterFinding, symbol_of
from serp.sysid.effect_search import LASTING
from serp.sysid.lifted_features import WORLD

CERTAIN: Final = 4.0
"""Standard errors. A file has many parameters, so false findings must be rare."""
_CHANGE: Final = 1e-4
"""Least cost: an error of 1 % of the change."""
_LEFT: Final = 0.002
"""Least cost as a fraction of the squared error that is left with all findings."""


def worthwhile(findings: Findings, explained: Sequence[Quantity], processes: set[str]) -> Findings:
    """Return the findings that are worth mentioning.

    * Parameters and missing effects: certain (4 standard errors), with a cost above that of an
      error of 1 % of the change (0.3 % in a process: its errors add up, while those of actions
      cancel out), and above 0.2 % of the squared error that is left.
    * Stochastic effects: all; only frequent ones are found.
    * Lines on reward or end: if the other findings leave an error of more than 10 %, and the cost
      of the line exceeds that too.

    Args:
        findings: All findings.
        explained: The accuracy with all findings.
        processes: Names of the processes of the file.
    """
    left = {quantity.name: quantity.squared_left for quantity in explained}
    unsettled = {quantity.name for quantity in explained if quantity.unexplained > WELL}

    def pays(finding: ParameterFinding | MissingEffect) -> bool:
        lasting = finding.schema == WORLD or finding.schema in processes
        rest = _LEFT * left.get(symbol_of(finding.fluent), 0.0)
        return finding.cost > max(LASTING if lasting else _CHANGE, rest)

    def certain(missing: MissingEffect) -> MissingEffect:
        terms = (term for term in missing.terms if abs(term.coefficient) > CERTAIN * term.error)
        return dataclasses.replace(missing, terms=tuple(terms))

    return dataclasses.replace(
        findings,
        parameters=tuple(f for f in findings.parameters if differs(f, CERTAIN) and pays(f)),
        missing=tuple(m for m in map(certain, findings.missing) if m.terms and pays(m)),
        rules=tuple(r for r in findings.rules if r.fluent in unsettled and r.cost > WELL**2),
    )


def without(findings: Findings, some: Findings) -> Findings:
    """Return the findings that are not in `some`."""
    parameters = {finding.parameter.index for finding in some.parameters}
    missing = {(finding.schema, finding.fluent) for finding in some.missing}
    return dataclasses.replace(
        findings,
        parameters=tuple(f for f in findings.parameters if f.parameter.index not in parameters),
        missing=tuple(f for f in findings.missing if (f.schema, f.fluent) not in missing),
        stochastic=tuple(f for f in findings.stochastic if f not in some.stochastic),
        rules=tuple(f for f in findings.rules if f not in some.rules),
    )


def differs(finding: ParameterFinding, errors: float) -> bool:
    """Return whether a parameter is that many standard errors from its estimate."""
    gap = abs(finding.estimate - finding.written)
    rounding = 1e-9 * max(abs(finding.estimate), abs(finding.written))
    return gap > max(errors * finding.error, rounding)
