"""Findings as sentences in the words of the domain file: what to write, and what was observed."""

from __future__ import annotations

from serp._util.text import measured, percent_measured, plain, plural, readable
from serp.model.ground import GroundModel
from serp.pddl.source import Place
from serp.runs.diagnosis.accuracy import END
from serp.runs.diagnosis.findings import (
    Finding,
    MissingEffect,
    ObservedOutcome,
    ParameterFinding,
    RuleFinding,
    StochasticEffect,
    symbol_of,
)


def place_of(finding: Finding) -> Place | None:
    """Return the place that a finding is about; None where it has none."""
    return finding.parameter.place if isinstance(finding, ParameterFinding) else finding.place


def symbols_of(finding: Finding) -> set[str]:
    """Return the symbols that a finding is about, with `reward`, and `terminal` for the end."""
    if isinstance(finding, StochasticEffect):
        return {symbol_of(name) for o in finding.outcomes for name, _ in o.changes}
    return {symbol_of(finding.fluent)}


def remark(finding: Finding, ground: GroundModel) -> str:
    """Return a finding as a sentence without a full stop."""
    place = place_of(finding)
    where = f"`{finding.schema}`" if finding.schema else ""
    if place is not None:
        file = "problem, " if place.source.name.endswith("problem.pddl") else ""
        where += f", {file}line {place.line}"
    steps = plural(finding.samples, "step")
    match finding:
        case ParameterFinding():
            observed = measured(finding.estimate, finding.error)
            return (
                f"{where}: write {finding.number} instead of {finding.parameter.place.text} for "
                f"`({finding.fluent})`; observed {observed} in {steps}"
            )
        case MissingEffect():
            effects = " ".join(finding.effect(term) for term in finding.terms)
            how = f"{where}: add" if finding.schema else "after every action: add a process with"
            return f"{how} `{effects}`; observed in {steps}"
        case StochasticEffect():
            return f"{where}: {outcomes_text(finding, ground)}"
    if place is not None:
        where += f": `{place.text}`"
    return f"{where}, {rule_text(finding)}" if where else rule_text(finding)


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


def _outcome(outcome: ObservedOutcome, predicates: set[str]) -> str:
    if not outcome.changes:
        return "nothing changes"
    return " and ".join(
        f"({fluent}) becomes {'true' if change > 0 else 'false'}"
        if symbol_of(fluent) in predicates
        else f"({fluent}) {'+' if change > 0 else '−'}{plain(abs(change))}"
        for fluent, change in outcome.changes
    )


def rule_text(finding: RuleFinding) -> str:
    """Return the observations of a line on rewards or ends, as a part of a sentence."""
    ends, unpredicted = finding.fluent == END, plural(finding.unpredicted, "step")
    observed = readable(finding.observed)
    if not finding.schema:
        if ends:
            return f"the task ended in {unpredicted}, and no line of the file says so"
        return f"{unpredicted} without a predicted reward had a reward of {observed} on average"
    if not finding.predicted:
        reward = "" if ends else f", with reward {observed} on average"
        return f"never predicted; it applied in {unpredicted}{reward}"
    text = f"predicted in {plural(finding.predicted, 'step')}"
    if ends:
        text += f"; the task ended in {finding.correct:,} of them"
    else:
        text += f", reward {readable(finding.expected)} on average; it was {observed}"
        text += f", and {finding.correct:,} steps were as predicted"
    return text + (f"; it also applied in {unpredicted} unpredicted" if finding.unpredicted else "")
