"""Findings as sentences in the words of the domain file, the most costly first."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from serp._util.number_format import measured, number, percent_measured, plain, rounded
from serp.diagnosis.findings import (
    EffectTerm,
    Finding,
    Findings,
    MissingEffect,
    ObservedOutcome,
    ParameterFinding,
    RuleFinding,
    StochasticEffect,
    symbol_of,
)
from serp.diagnosis.relevance import differs
from serp.model.ground import GroundEffect, GroundModel, GroundSchema, Parameter
from serp.pddl.source import Place
from serp.sysid.monitor import END

_DIFFERS = 2.0
"""Standard errors by which a parameter differs from its estimate at least."""


class Remark(NamedTuple):
    """One sentence about the file.

    Attributes:
        cost: Sum over its findings; see `serp.diagnosis.findings`.
        schema: Name of the action or process schema; empty for a change under every action.
        line: Line of the file; None where there is none.
        text: The sentence, without a full stop.
        findings: The findings that it states.
    """

    cost: float
    schema: str
    line: int | None
    text: str
    findings: tuple[Finding, ...]

    @property
    def symbols(self) -> tuple[str, ...]:
        """The symbols of its fluents, with `reward`, and `terminal` for the end."""
        names: list[str] = []
        for finding in self.findings:
            if isinstance(finding, StochasticEffect):
                names += [name for o in finding.outcomes for name, _ in o.changes]
            else:
                names.append(finding.fluent)
        return tuple(dict.fromkeys(symbol_of(name) for name in names))


def remarks(findings: Findings, ground: GroundModel) -> list[Remark]:
    """Return the remarks about a file, the most costly first.

    Findings about one fluent in one schema share a remark. A parameter that agrees with its
    estimate is left out, unless an effect is missing beside it.

    Args:
        findings: The findings.
        ground: The instantiated domain that they are about.
    """
    writer = _RemarkWriter(ground)
    found = [writer.stochastic(effect) for effect in findings.stochastic]
    found += [writer.rule(rule) for rule in findings.rules]
    groups: dict[tuple[str, str], list[ParameterFinding | MissingEffect]] = {}
    changes: list[ParameterFinding | MissingEffect] = [*findings.parameters, *findings.missing]
    for finding in changes:
        groups.setdefault((finding.schema, symbol_of(finding.fluent)), []).append(finding)
    for group in groups.values():
        found += writer.group(group)
    return sorted(found, key=lambda remark: -remark.cost)


class _RemarkWriter:
    """Writes remarks with the names and places of one domain."""

    def __init__(self, ground: GroundModel) -> None:
        self._schemas: tuple[GroundSchema, ...] = (*ground.actions, *ground.processes)
        self._effects: list[GroundEffect] = [e for s in self._schemas for e in s.effects]
        self._predicates = {f.symbol for f in ground.fluents if not f.numeric}
        self._symbols = [f.symbol for f in ground.fluents]
        self._parameters = ground.parameters

    def group(self, group: list[ParameterFinding | MissingEffect]) -> Iterator[Remark]:
        """Yield the remarks on one fluent in one schema."""
        missing = [finding for finding in group if isinstance(finding, MissingEffect)]
        parameters = [finding for finding in group if isinstance(finding, ParameterFinding)]
        effects: dict[str, list[ParameterFinding]] = {}
        for finding in parameters:
            effects.setdefault(self._effect_around(finding.parameter), []).append(finding)
        ranked = sorted(effects.items(), key=lambda item: -sum(f.cost for f in item[1]))
        for effect, found in ranked:
            wrong = [finding for finding in found if differs(finding, _DIFFERS)]
            if wrong or missing:
                yield self._parameters_in(effect, found, wrong, missing)
                missing = []  # reported with the first effect on the same fluent
        for effect_missing in missing:
            yield self._missing(effect_missing)

    def _parameters_in(
        self,
        effect: str,
        found: list[ParameterFinding],
        wrong: list[ParameterFinding],
        missing: list[MissingEffect],
    ) -> Remark:
        place = found[0].parameter.place
        single = self._parameters_of(effect, place) == 1
        parts = [
            f"observed {measured(f.estimate, f.error)}"
            + ("" if single else f" for {f.parameter.place.text}")
            + f" in {f.samples:,} steps"
            for f in sorted(wrong, key=lambda finding: -finding.cost)
        ]
        parts += [f"plus {terms(m.terms)} that the file does not mention" for m in missing]
        as_is = "; " if wrong else ", as observed; "
        return _remark(
            (*wrong, *missing),
            found[0].schema,
            place,
            f"`{found[0].schema}`, {_line(place)}: `{effect}`" + as_is + "; ".join(parts),
        )

    def _missing(self, finding: MissingEffect) -> Remark:
        mentions = any(
            effect.target >= 0 and self._symbols[effect.target] == symbol_of(finding.fluent)
            for schema in self._schemas
            if schema.schema == finding.schema
            for effect in schema.effects
        )
        how = "beyond what the file says" if mentions else "which the file does not mention"
        per = " per unit of time" if finding.rate else ""
        who = "whatever the action" if not finding.schema else f"`{finding.schema}`"
        where = "" if finding.place is None else f", {_line(finding.place)}"
        return _remark(
            (finding,),
            finding.schema,
            finding.place,
            f"{who}{where}: `{_bracketed(finding.fluent)}` changes by "
            f"{terms(finding.terms)}{per}, {how} ({finding.samples:,} steps)",
        )

    def stochastic(self, finding: StochasticEffect) -> Remark:
        """Return the remark on the outcomes of an action."""
        written = [o for o in finding.outcomes if o.written]
        others = [o for o in finding.outcomes if not o.written]
        steps = f"of {finding.samples:,} steps"
        if written:
            share = percent_measured(sum(o.probability for o in written), written[0].error)
            what = f"does what the file says ({self._changed(written[0])}) in {share} {steps}"
        else:
            what = f"never does what the file says, in {steps[3:]}"
        if others:
            what += "; instead " + ", ".join(
                f"{self._changed(o)} in {percent_measured(o.probability, o.error)}" for o in others
            )
        text = f"`{finding.schema}`, {_line(finding.place)}: {what}"
        return _remark((finding,), finding.schema, finding.place, text)

    def rule(self, finding: RuleFinding) -> Remark:
        """Return the remark on a line on rewards or ends."""
        ends, steps = finding.fluent == END, _steps(finding.predicted)
        unpredicted, place = _steps(finding.unpredicted), finding.place
        if not finding.schema and ends:
            text = f"the task ended in {unpredicted}, and no line of the file says so"
        elif not finding.schema:
            text = f"{unpredicted} without a predicted reward had a reward of "
            text += f"{number(finding.observed)} on average"
        elif not finding.predicted:
            text = f", never predicted; it applied in {unpredicted}"
            text += "" if ends else f", with reward {number(finding.observed)} on average"
        else:
            text = f", predicted in {steps}"
            if ends:
                text += f"; the task ended in {finding.came:,} of them"
            else:
                text += f", reward {number(finding.expected)} on average; it was "
                text += f"{number(finding.observed)}, and {finding.came:,} steps were as predicted"
            text += f"; it also applied in {unpredicted} unpredicted" if finding.unpredicted else ""
        if finding.schema:
            where = "" if place is None else f", {_line(place)}: `{place.text}`"
            text = f"`{finding.schema}`{where}{text}"
        return _remark((finding,), finding.schema, place, text)

    def _changed(self, outcome: ObservedOutcome) -> str:
        if not outcome.changes:
            return "nothing changes"
        return " and ".join(self._change(symbol, change) for symbol, change in outcome.changes)

    def _change(self, fluent: str, change: float) -> str:
        if symbol_of(fluent) in self._predicates:
            return f"{_bracketed(fluent)} becomes {'true' if change > 0 else 'false'}"
        return f"{_bracketed(fluent)} {'+' if change > 0 else '−'}{plain(abs(change))}"

    def _effect_around(self, parameter: Parameter) -> str:
        """Return the text of the innermost effect that contains a parameter."""
        place = parameter.place
        around = [effect.place for effect in self._effects if _inside(place, effect.place)]
        if not around:  # a static value of the problem, for example
            return place.source_line.strip() or place.text
        return min(around, key=lambda outer: outer.end - outer.start).text

    def _parameters_of(self, effect: str, place: Place) -> int:
        """Return the number of parameters in the effect around a place."""
        for outer in (e.place for e in self._effects if e.place.text == effect):
            if _inside(place, outer):
                return len({p.place.start for p in self._parameters if _inside(p.place, outer)})
        return 1


def terms(summands: Iterable[EffectTerm]) -> str:
    """Format a sum: `0.31 × pole-angle − 0.02`.

    Each coefficient has as many digits as its standard error allows.
    """
    text = ""
    for term in summands:
        value = rounded(abs(term.coefficient), term.error)
        product = " × ".join([value, *(f if " " not in f else _bracketed(f) for f in term.fluents)])
        sign = "−" if term.coefficient < 0 else "+"
        if text:
            text += f" {sign} {product}"
        else:
            text = product if sign == "+" else f"−{product}"
    return text or "0"


def _remark(findings: tuple[Finding, ...], schema: str, place: Place | None, text: str) -> Remark:
    cost = sum(finding.cost for finding in findings)
    return Remark(cost, schema, None if place is None else place.line, text, findings)


def _steps(count: int) -> str:
    return f"{count:,} step{'' if count == 1 else 's'}"


def _bracketed(fluent: str) -> str:
    return fluent if fluent.startswith("(") else f"({fluent})"


def _line(place: Place) -> str:
    file = "" if not place.source.name.endswith("problem.pddl") else "problem, "
    return f"{file}line {place.line}"


def _inside(inner: Place, outer: Place) -> bool:
    return inner.source is outer.source and outer.start <= inner.start and inner.end <= outer.end
