"""Findings in the words of the domain file, the most costly first."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from serp.diagnosis.findings import (
    EffectTerm,
    Findings,
    MissingEffect,
    ObservedOutcome,
    OutcomeFinding,
    ParameterFinding,
    RuleFinding,
)
from serp.diagnosis.relevance import differs
from serp.model.ground import GroundEffect, GroundModel, GroundSchema, Parameter
from serp.pddl.source import Place
from serp.sysid.monitor import END

Finding = ParameterFinding | MissingEffect | OutcomeFinding | RuleFinding

_DIFFERS = 2.0
"""A literal differs from its estimate where so many standard errors lie between them."""


_DIGITS = 6
"""Decimals beyond which a standard error is not worth showing."""


class Remark(NamedTuple):
    """One thing to be said of the file.

    Attributes:
        cost: Of all findings that it tells together; see `serp.diagnosis.findings`.
        schema: Name of the action or process schema; empty where it is about the world as such.
        line: Line of the file; None where there is none.
        text: A sentence without a full stop.
        findings: What it tells.
    """

    cost: float
    schema: str
    line: int | None
    text: str
    findings: tuple[Finding, ...]

    @property
    def symbols(self) -> tuple[str, ...]:
        """The symbols of the fluents that it is about; `reward`, or `terminal` for the end."""
        names: list[str] = []
        for finding in self.findings:
            if isinstance(finding, OutcomeFinding):
                names += [name for o in finding.outcomes for name, _ in o.changes]
            else:
                names.append(finding.fluent)
        return tuple(dict.fromkeys(_symbol(name) for name in names))


def remarks(findings: Findings, ground: GroundModel) -> list[Remark]:
    """Return what is to be said of a file, the most costly first.

    What is found of one fluent in one schema is told together. Literals that agree with what was
    observed are left out, unless something is missing beside them.

    Args:
        findings: What was found.
        ground: The instantiated domain that it was found of.
    """
    words = _Words(ground)
    told = [words.of_outcome(outcome) for outcome in findings.outcomes]
    told += [words.of_rule(rule) for rule in findings.rules]
    groups: dict[tuple[str, str], list[ParameterFinding | MissingEffect]] = {}
    changes: list[ParameterFinding | MissingEffect] = [*findings.literals, *findings.missing]
    for finding in changes:
        key = finding.schema, _symbol(finding.fluent)
        groups.setdefault(key, []).append(finding)
    for group in groups.values():
        told += words.of_group(group)
    return sorted(told, key=lambda remark: -remark.cost)


class _Words:
    """The names and places of one domain."""

    def __init__(self, ground: GroundModel) -> None:
        self._schemas: tuple[GroundSchema, ...] = (*ground.actions, *ground.processes)
        self._effects: list[GroundEffect] = [e for s in self._schemas for e in s.effects]
        self._predicates = {f.symbol for f in ground.fluents if not f.numeric}
        self._symbols = [f.symbol for f in ground.fluents]
        self._parameters = ground.parameters

    def of_group(self, group: list[ParameterFinding | MissingEffect]) -> Iterator[Remark]:
        """Tell what was found of one fluent in one schema."""
        missing = [finding for finding in group if isinstance(finding, MissingEffect)]
        literals = [finding for finding in group if isinstance(finding, ParameterFinding)]
        effects: dict[str, list[ParameterFinding]] = {}
        for literal in literals:
            effects.setdefault(self._effect(literal.parameter), []).append(literal)
        ranked = sorted(effects.items(), key=lambda item: -sum(f.cost for f in item[1]))
        rates = {self._is_process(finding.schema) for finding in literals}
        for effect, found in ranked:
            wrong = [finding for finding in found if differs(finding, _DIFFERS)]
            # What is missing is told with the first effect that changes the same fluent, in the
            # same unit: a rate beside a rate.
            beside = [m for m in missing if rates == {m.rate}]
            if not wrong and not beside:
                continue
            missing = [m for m in missing if m not in beside]
            yield self._of_effect(effect, found, wrong, beside)
        for finding in missing:
            yield self._of_missing(finding)

    def _of_effect(
        self,
        effect: str,
        found: list[ParameterFinding],
        wrong: list[ParameterFinding],
        missing: list[MissingEffect],
    ) -> Remark:
        place = found[0].parameter.place
        alone = self._literals_in(effect, place) == 1
        parts = [
            f"observed {measured(f.estimate, f.error)}"
            + ("" if alone else f" for {f.parameter.place.text}")
            + f" in {f.samples:,} steps"
            for f in sorted(wrong, key=lambda finding: -finding.cost)
        ]
        parts += [f"plus {terms(m.terms)} that the file does not mention" for m in missing]
        as_is = "; " if wrong else ", as observed; "
        told: tuple[Finding, ...] = (*wrong, *missing)
        return Remark(
            cost=sum(finding.cost for finding in told),
            schema=found[0].schema,
            line=place.line,
            text=f"`{found[0].schema}`, {_line(place)}: `{effect}`" + as_is + "; ".join(parts),
            findings=told,
        )

    def _of_missing(self, finding: MissingEffect) -> Remark:
        mentions = any(
            schema.schema == finding.schema and self._changes(schema, finding.fluent)
            for schema in self._schemas
        )
        how = "beyond what the file says" if mentions else "which the file does not mention"
        per = " per unit of time" if finding.rate else ""
        who = "whatever the action" if not finding.schema else f"`{finding.schema}`"
        where = "" if finding.place is None else f", {_line(finding.place)}"
        return Remark(
            cost=finding.cost,
            schema=finding.schema,
            line=None if finding.place is None else finding.place.line,
            text=f"{who}{where}: `{_bracketed(finding.fluent)}` changes by "
            f"{terms(finding.terms)}{per}, {how} ({finding.samples:,} steps)",
            findings=(finding,),
        )

    def of_outcome(self, finding: OutcomeFinding) -> Remark:
        """Tell what comes of an action."""
        written = [o for o in finding.outcomes if o.written]
        others = [o for o in finding.outcomes if not o.written]
        steps = f"of {finding.samples:,} steps"
        if written:
            what = f"does what the file says ({self._changed(written[0])}) in "
            what += f"{_percent(sum(o.probability for o in written), written[0].error)} {steps}"
        else:
            what = f"never does what the file says, in none {steps}"
        if others:
            what += "; instead " + ", ".join(
                f"{self._changed(o)} in {_percent(o.probability, o.error)}" for o in others
            )
        return Remark(
            cost=finding.cost,
            schema=finding.schema,
            line=finding.place.line,
            text=f"`{finding.schema}`, {_line(finding.place)}: {what}",
            findings=(finding,),
        )

    def of_rule(self, finding: RuleFinding) -> Remark:
        """Tell what came of a line on rewards or ends."""
        ends, steps = finding.fluent == END, _steps(finding.predicted)
        surprises = _steps(finding.unpredicted)
        if not finding.schema and ends:
            text = f"the task ended in {surprises} of which no line says so"
        elif not finding.schema:
            text = f"{surprises} for which the file promises no reward were worth "
            text += f"{number(finding.observed)} on average"
        elif not finding.predicted:
            text = f", never predicted; it applies to {surprises} all the same"
            text += "" if ends else f", worth {number(finding.observed)} on average"
        else:
            text = f", predicted in {steps}"
            if ends:
                text += f"; the task ended in {finding.came:,} of them"
            else:
                text += f", reward {number(finding.promised)} on average; it was "
                text += f"{number(finding.observed)}, and {finding.came:,} steps were as predicted"
            text += f"; it applies to {surprises} more" if finding.unpredicted else ""
        place = finding.place
        if finding.schema:
            where = "" if place is None else f", {_line(place)}"
            effect = "" if place is None else f": `{place.text}`"
            text = f"`{finding.schema}`{where}{effect}{text}"
        return Remark(
            cost=finding.cost,
            schema=finding.schema,
            line=None if place is None else place.line,
            text=text,
            findings=(finding,),
        )

    def _changed(self, outcome: ObservedOutcome) -> str:
        if not outcome.changes:
            return "nothing changes"
        return " and ".join(self._change(symbol, change) for symbol, change in outcome.changes)

    def _change(self, fluent: str, change: float) -> str:
        if _symbol(fluent) in self._predicates:
            return f"{_bracketed(fluent)} becomes {'true' if change > 0 else 'false'}"
        return f"{_bracketed(fluent)} {'+' if change > 0 else '−'}{_plain(abs(change))}"

    def _effect(self, parameter: Parameter) -> str:
        """Return the text of the innermost effect in which a literal stands."""
        place = parameter.place
        around = [effect.place for effect in self._effects if _inside(place, effect.place)]
        if not around:  # a static value of the problem, or such
            return place.source_line.strip() or place.text
        return min(around, key=lambda outer: outer.end - outer.start).text

    def _literals_in(self, effect: str, place: Place) -> int:
        """Return how many literals stand in the effect around a place."""
        around = [
            outer.place
            for outer in self._effects
            if _inside(place, outer.place) and outer.place.text == effect
        ]
        if not around:
            return 1
        return len({p.place.start for p in self._parameters if _inside(p.place, around[0])})

    def _is_process(self, name: str) -> bool:
        """Whether a schema is a process, whose effects are rates."""
        return any(s.schema == name and s.kind.value == "process" for s in self._schemas)

    def _changes(self, schema: GroundSchema, fluent: str) -> bool:
        return any(
            effect.target >= 0 and self._symbols[effect.target] == _symbol(fluent)
            for effect in schema.effects
        )


def terms(summands: Iterable[EffectTerm]) -> str:
    """Return a sum as people read it: `0.31 × pole-angle − 0.02`.

    Each coefficient has the digits that its standard error leaves.
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


def measured(value: float, error: float) -> str:
    """Return a value with its standard error: `0.21 ± 0.02`."""
    if not math.isfinite(error) or error <= 1e-9 * abs(value):
        return _signed(_plain(value))
    decimals = _decimals(error)
    if decimals > _DIGITS:
        return _signed(_plain(value))
    shown = round(error, decimals)
    return f"{_signed(_fixed(value, decimals))} ± {_fixed(shown, decimals)}"


def rounded(value: float, error: float) -> str:
    """Return a value with the digits that its standard error leaves."""
    if not math.isfinite(error) or error <= 1e-9 * abs(value):
        return _plain(value)
    decimals = _decimals(error)
    if decimals > _DIGITS:
        return _signed(_plain(value))
    if round(value, decimals) == 0.0:  # all of it is uncertain; a zero would say less
        return f"{value:.1g}"
    return _signed(_fixed(value, decimals))


def _decimals(error: float) -> int:
    """Return the decimals up to the first digit of an error, or its second after a one."""
    place = math.floor(math.log10(error))
    first = int(error / 10.0**place)
    return -place + (1 if first == 1 else 0)


def _fixed(value: float, decimals: int) -> str:
    if decimals < 0 and abs(value) >= 1e9:
        return f"{value:.3g}"
    return f"{round(value, decimals) + 0.0:,.{max(0, decimals)}f}"


def _plain(value: float) -> str:
    return f"{value + 0.0:.6g}"


def _signed(text: str) -> str:
    return text.replace("-", "−", 1) if text.startswith("-") else text


def _percent(share: float, error: float) -> str:
    if not math.isfinite(error) or error < 0.0005:
        return f"{100 * share:.1f} %" if 0 < share < 0.1 else f"{100 * share:.0f} %"
    decimals = 1 if error < 0.005 else 0
    return f"{100 * share:.{decimals}f} ± {100 * error:.{decimals}f} %"


def number(value: float) -> str:
    """Return a number with three digits, as people read it."""
    return _signed(f"{value + 0.0:.3g}")


def _steps(count: int) -> str:
    return f"{count:,} step{'' if count == 1 else 's'}"


def _symbol(fluent: str) -> str:
    return fluent.strip("() ").split(" ")[0]


def _bracketed(fluent: str) -> str:
    return fluent if fluent.startswith("(") else f"({fluent})"


def _line(place: Place) -> str:
    file = "" if not place.source.name.endswith("problem.pddl") else "problem, "
    return f"{file}line {place.line}"


def _inside(inner: Place, outer: Place) -> bool:
    return inner.source is outer.source and outer.start <= inner.start and inner.end <= outer.end
