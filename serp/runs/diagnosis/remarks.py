"""Findings as sentences in the words of the domain file, the most costly first."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from serp._util.text import measured, percent, percent_measured, plain, plural, readable, rounded
from serp.model.ground import GroundModel
from serp.pddl.source import Place
from serp.runs.diagnosis.accuracy import END, REWARD, WELL, Quantity, differs
from serp.runs.diagnosis.findings import (
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

_DIFFERS = 2.0
"""Standard errors by which a parameter differs from its estimate at least."""


class Remark(NamedTuple):
    """One sentence about the file.

    Attributes:
        cost: Sum over its findings; see `serp.runs.diagnosis.findings`.
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
    found = [
        _remark((f,), f.schema, f.place, f"`{f.schema}`{_at(f.place)}: {outcomes_text(f, ground)}")
        for f in findings.stochastic
    ]
    for rule in findings.rules:
        where = "" if rule.place is None else f"{_at(rule.place)}: `{rule.place.text}`"
        of_line = f"`{rule.schema}`{where}, " if rule.schema else ""
        found.append(_remark((rule,), rule.schema, rule.place, of_line + rule_text(rule)))
    groups: dict[tuple[str, str], tuple[list[ParameterFinding], list[MissingEffect]]] = {}
    for parameter in findings.parameters:
        key = parameter.schema, symbol_of(parameter.fluent)
        groups.setdefault(key, ([], []))[0].append(parameter)
    for effect in findings.missing:
        groups.setdefault((effect.schema, symbol_of(effect.fluent)), ([], []))[1].append(effect)
    for parameters, missing in groups.values():
        found += _changes(parameters, missing, ground)
    return sorted(found, key=lambda remark: -remark.cost)


def outcomes_text(finding: StochasticEffect, ground: GroundModel) -> str:
    """Return the observed outcomes of an action, as a part of a sentence."""
    predicates = {f.symbol for f in ground.fluents if not f.numeric}
    written = [o for o in finding.outcomes if o.written]
    others = [o for o in finding.outcomes if not o.written]
    steps = plural(finding.samples, "step")
    if written:
        share = percent_measured(sum(o.probability for o in written), written[0].error)
        text = f"does what the file says ({_outcome(written[0], predicates)}) in {share} of {steps}"
    else:
        text = f"never does what the file says, in {steps}"
    instead = ", ".join(
        f"{_outcome(o, predicates)} in {percent_measured(o.probability, o.error)}" for o in others
    )
    return f"{text}; instead {instead}" if others else text


def rule_text(finding: RuleFinding) -> str:
    """Return the observations of a line on rewards or ends, as a part of a sentence."""
    ends, unpredicted = finding.fluent == END, plural(finding.unpredicted, "step")
    if not finding.schema:
        if ends:
            return f"the task ended in {unpredicted}, and no line of the file says so"
        reward = f"a reward of {readable(finding.observed)} on average"
        return f"{unpredicted} without a predicted reward had {reward}"
    if not finding.predicted:
        reward = "" if ends else f", with reward {readable(finding.observed)} on average"
        return f"never predicted; it applied in {unpredicted}{reward}"
    text = f"predicted in {plural(finding.predicted, 'step')}"
    if ends:
        text += f"; the task ended in {finding.came:,} of them"
    else:
        text += f", reward {readable(finding.expected)} on average; it was "
        text += f"{readable(finding.observed)}, and {finding.came:,} steps were as predicted"
    return text + (f"; it also applied in {unpredicted} unpredicted" if finding.unpredicted else "")


def terms(summands: Iterable[EffectTerm]) -> str:
    """Format a sum: `0.31 × pole-angle − 0.02`.

    Each coefficient has as many digits as its standard error allows.
    """
    text = ""
    for term in summands:
        value = rounded(abs(term.coefficient), term.error)
        product = " × ".join([value, *(f if " " not in f else f"({f})" for f in term.fluents)])
        sign = "−" if term.coefficient < 0 else "+"
        text += f" {sign} {product}" if text else f"{sign.removeprefix('+')}{product}"
    return text or "0"


def _changes(
    parameters: list[ParameterFinding], missing: list[MissingEffect], ground: GroundModel
) -> Iterator[Remark]:
    """Yield the remarks on what is found of one fluent in one schema."""
    effects: dict[Place, list[ParameterFinding]] = {}
    for finding in parameters:
        effects.setdefault(_effect_around(finding.parameter.place, ground), []).append(finding)
    ranked = sorted(effects.items(), key=lambda item: -sum(f.cost for f in item[1]))
    for effect, found in ranked:
        wrong = [finding for finding in found if differs(finding, _DIFFERS)]
        if wrong or missing:
            yield _effect_remark(effect, found[0], wrong, missing, ground)
            missing = []  # reported with the first effect on the same fluent
    for absent in missing:
        yield _missing_remark(absent, ground)


def _effect_remark(
    effect: Place,
    first: ParameterFinding,
    wrong: list[ParameterFinding],
    missing: list[MissingEffect],
    ground: GroundModel,
) -> Remark:
    inside = {p.place.start for p in ground.parameters if _inside(p.place, effect)}
    place = first.parameter.place
    text = effect.text
    if effect == place:  # a static value of the problem, for example
        text = place.source_line.strip() or text
    parts = [
        f"observed {measured(f.estimate, f.error)}"
        + (f" for {f.parameter.place.text}" if len(inside) > 1 else "")
        + f" in {f.samples:,} steps"
        for f in sorted(wrong, key=lambda finding: -finding.cost)
    ]
    parts += [f"plus {terms(m.terms)} that the file does not mention" for m in missing]
    as_is = "; " if wrong else ", as observed; "
    text = f"`{first.schema}`{_at(place)}: `{text}`{as_is}{'; '.join(parts)}"
    return _remark((*wrong, *missing), first.schema, place, text)


def _missing_remark(finding: MissingEffect, ground: GroundModel) -> Remark:
    symbols = [fluent.symbol for fluent in ground.fluents]
    mentions = any(
        effect.target >= 0 and symbols[effect.target] == symbol_of(finding.fluent)
        for schema in (*ground.actions, *ground.processes)
        if schema.schema == finding.schema
        for effect in schema.effects
    )
    how = "beyond what the file says" if mentions else "which the file does not mention"
    per = " per unit of time" if finding.rate else ""
    who = f"`{finding.schema}`" if finding.schema else "whatever the action"
    where = "" if finding.place is None else _at(finding.place)
    text = (
        f"{who}{where}: `({finding.fluent})` changes by {terms(finding.terms)}{per}, {how} "
        f"({finding.samples:,} steps)"
    )
    return _remark((finding,), finding.schema, finding.place, text)


def _outcome(outcome: ObservedOutcome, predicates: set[str]) -> str:
    if not outcome.changes:
        return "nothing changes"
    return " and ".join(
        f"({fluent}) becomes {'true' if change > 0 else 'false'}"
        if symbol_of(fluent) in predicates
        else f"({fluent}) {'+' if change > 0 else '−'}{plain(abs(change))}"
        for fluent, change in outcome.changes
    )


def _effect_around(place: Place, ground: GroundModel) -> Place:
    """Return the place of the innermost effect around a place; itself where there is none."""
    effects = [e.place for s in (*ground.actions, *ground.processes) for e in s.effects]
    around = [outer for outer in effects if _inside(place, outer)]
    return min(around, key=lambda outer: outer.end - outer.start, default=place)


def _inside(inner: Place, outer: Place) -> bool:
    return inner.source is outer.source and outer.start <= inner.start and inner.end <= outer.end


def _remark(findings: tuple[Finding, ...], schema: str, place: Place | None, text: str) -> Remark:
    cost = sum(finding.cost for finding in findings)
    return Remark(cost, schema, None if place is None else place.line, text, findings)


def _at(place: Place) -> str:
    file = "problem, " if place.source.name.endswith("problem.pddl") else ""
    return f", {file}line {place.line}"


_EXACT = 1e-9


def verdict(quantities: Sequence[Quantity], found: bool) -> str:
    """Return a sentence on the accuracy of a file one step ahead.

    Args:
        quantities: All quantities that change or are predicted to. A file predicts well if the
            error of each is at most 10 % of its change.
        found: Whether any finding is worth mentioning.
    """
    if not quantities:
        return "Nothing changed in these steps, as predicted; they show nothing more of the file."
    well = [q for q in quantities if q.off <= WELL]
    worst = max(quantities, key=lambda q: q.off)
    if len(well) == len(quantities):
        error = "one step ahead it is exact"
        if worst.off > _EXACT:
            error = f"one step ahead every error is at most {percent(worst.off)} of the change"
            error += f", that of {worst.shown}"
        rest = "The findings below would improve it." if found else "Nothing more was found."
        return f"The file predicts well: {error}. {rest}"
    counted = f"{len(well)} of {len(quantities)}"
    listed = "no improvement was found"
    if found:
        chance = ", apart from chance," if any(q.squared_chance for q in quantities) else ""
        better = sum(q.unexplained <= WELL for q in quantities)
        listed = f"with the findings below{chance} {better} of {len(quantities)}"
    return (
        f"One step ahead the file as written predicts {counted} ({_names(quantities)}) to within "
        f"{percent(WELL)} of the change; {listed}. The largest error is "
        f"{percent(worst.off)} of the change, that of {worst.shown}."
    )


def unexplained(quantities: Sequence[Quantity]) -> list[str]:
    """Return a sentence for each unexplained quantity, the worst first.

    A quantity is explained if the patched file predicts it to within 10 % of its change, apart
    from the expected error of the stochastic effects found.
    """
    rest = sorted((q for q in quantities if q.unexplained > WELL), key=lambda q: -q.unexplained)
    return [_sentence(quantity) for quantity in rest]


def _sentence(q: Quantity) -> str:
    differs = abs(q.squared_left - q.squared) > 0.01 * q.squared
    listed = f"; with the findings {percent(q.off_left)}" if differs else ""
    mostly = f"; most of it after `{q.action}`" if q.most > 0.5 and q.squared else ""
    if q.name == END:
        missed = int(q.change) - q.right
        what = f"the task ended in {q.change:,.0f} of {q.steps:,} steps"
        said = f"; {q.said:,} ends were predicted, {q.right:,} of them correctly, and {missed:,} "
        said += "ends were not predicted"
        mostly = ""
    elif not q.numeric:
        what = f"{q.shown} changes {q.change:,.0f} times in {q.steps:,} steps"
        said = f"; {q.said:,} changes were predicted, {q.right:,} of them correctly"
        said += f" (wrong {percent(q.off)} as often as it changes)"
    elif not q.change:
        still = "the reward is 0" if q.name == REWARD else f"{q.shown} does not change"
        what, said = f"{still} in all {q.steps:,} steps", ", though the file predicts that it does"
    else:
        moves = "the reward is" if q.name == REWARD else f"{q.shown} changes by"
        what = f"{moves} {readable(q.change)} a step"
        error = readable(q.change * q.off)
        said = f", the error of the file is {error} ({percent(q.off)})"
    if q.change and not q.written:
        said = ", and nothing in the file says so"
    return f"{what}{said}{listed}{mostly}"


def _names(quantities: Sequence[Quantity]) -> str:
    fluents = sum(q.name not in (REWARD, END) for q in quantities)
    named = [f"{fluents} fluents" if fluents > 1 else "a fluent"] if fluents else []
    others = {REWARD: "the reward", END: "the end"}
    named += [others[q.name] for q in quantities if q.name in others]
    return " and ".join([", ".join(named[:-1]), named[-1]] if len(named) > 1 else named)
