"""Repair of a domain file by the findings of a run.

Parameters are changed in place, missing effects are added to their action or as a process, and what
was seen to happen by chance becomes `(probabilistic ...)`, each with its evidence as a comment.
Every other byte of the file is kept. Rewards, unsafe and terminal are only commented on.
`serp.runs.diagnosis.accuracy` decides which findings are written.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from serp._util.text import measured, plain
from serp.model.domain import Domain
from serp.pddl import syntax as x
from serp.pddl.reader import Group, Word, read_group
from serp.pddl.source import (
    Edit,
    Place,
    Source,
    edited,
    indent_at,
    line_end,
    line_start,
    newline_of,
)
from serp.runs.diagnosis.findings import (
    EffectTerm,
    Findings,
    MissingEffect,
    ParameterFinding,
    RuleFinding,
    StochasticEffect,
    symbol_of,
)

CHANCE = ":probabilistic-effects"
_ASCII = str.maketrans({"−": "-", "…": "...", "×": "*", "±": "+/-"})


@dataclass(frozen=True)
class Repaired:
    """A repaired domain file.

    Attributes:
        text: The whole text.
        changes: For each number, effect or comment that is changed or new: the line of the file as
            it was; for an addition the line of what it is added to.
    """

    text: str
    changes: tuple[int, ...]


def repair(domain: Domain, findings: Findings) -> Repaired:
    """Return the domain file with findings written into it.

    Parameters are changed, missing and stochastic effects are added; findings on rewards and ends
    become comments, and so do stochastic effects that the action cannot name. The result has been
    parsed and instantiated.

    Raises:
        DomainError: The repaired file and the problem would not be valid.
    """
    writer = _Writer(domain, findings)
    edits = writer.edits()
    if not writer.changes:
        return Repaired(domain.source.text, ())
    text = edited(domain.source.text, edits)
    source = Source(f"{domain.source.name} (repaired)", text)
    limit = domain.max_ground_schemas
    Domain.parse(source, domain.problem_source, max_ground_schemas=limit).model  # noqa: B018
    return Repaired(text, tuple(sorted(writer.changes)))


class _Writer:
    """Collects the edits of one file, and in `changes` the lines that they change."""

    def __init__(self, domain: Domain, findings: Findings) -> None:
        self.changes: list[int] = []
        self._findings = findings
        self._domain = domain
        self._syntax = domain.syntax
        self._text = domain.source.text
        self._newline = newline_of(self._text)
        top = read_group(domain.source)
        self._groups = [item for item in top.items if isinstance(item, Group)]
        self._names = {
            *(schema.name for schema in self._syntax.schemas),
            *self._syntax.declarations,
            *self._syntax.constants,
            *self._syntax.parents,
        }

    def edits(self) -> list[Edit]:
        """Return all edits, and note the lines that they change."""
        source, findings = self._domain.source, self._findings
        edits = [edit for finding in findings.parameters for edit in self._number(finding)]
        edits += self._additions()
        observed: list[RuleFinding | StochasticEffect] = [*findings.rules, *findings.stochastic]
        chance_named = False
        for finding in observed:
            if finding.place is not None and finding.place.source is source:
                self.changes.append(finding.place.line)
                if isinstance(finding, StochasticEffect) and (found := self._chance(finding)):
                    edits += found
                    chance_named = True
                    continue
                observation = finding.observation(self._domain.model.ground)
                edits.append(self._comment_above(finding.place, f"Observed: {observation}."))
        listed = next((g for g in self._groups if g.head == ":requirements"), None)
        if chance_named and listed and CHANCE not in self._syntax.requirements:
            edits.append(Edit(listed.place.end - 1, listed.place.end - 1, f" {CHANCE}"))
        return edits

    def _chance(self, finding: StochasticEffect) -> list[Edit]:
        """Return the edits that make some effects of an action one of several outcomes.

        There are none where an outcome is not a matter of the action's own parameters, or where
        the effects are changed otherwise, too.
        """
        schema = next(s for s in self._syntax.schemas if s.place == finding.place)
        symbols = finding.symbols
        own = [effect for effect in schema.effects if x.changed_names(effect) & symbols]
        edited = {finding.place.start for finding in self._findings.parameters}
        written = sum(outcome.probability for outcome in finding.outcomes if outcome.written)
        outcomes = self._outcomes(finding, {parameter.name for parameter in schema.parameters})
        if (
            outcomes is None
            or not own
            or not all(x.changed_names(effect) <= symbols for effect in own)
            or any(isinstance(node, x.Chance) for node in x.nodes_in(schema.effects))
            or any(e.place.start <= at < e.place.end for e in own for at in edited)
            or schema.name in {missing.schema for missing in self._findings.missing}
        ):
            return []
        rest = 1.0 - sum(float(share) for share, _ in outcomes)
        if len(outcomes) < sum(not outcome.written for outcome in finding.outcomes):
            rest = min(rest, written)  # with what is left, nothing happens
        first = _share(rest + 1e-9, 0.0)
        if float(first) <= 0.0 or written <= 0.0:
            return []
        text, line = self._text, self._newline
        base = indent_at(text, own[0].place.start)
        indent = base + "  "
        evidence = self._comment(finding.observation(self._domain.model.ground), indent)
        kept = " ".join(effect.place.text for effect in own)
        kept = f"(and {kept})" if len(own) > 1 else kept
        others = "".join(f"{line}{indent}{share} {effect}" for share, effect in outcomes)
        chance = f"(probabilistic{line}{evidence}{indent}{first} {kept}{others})"
        edits = [Edit(own[0].place.start, own[0].place.end, chance)]
        for effect in own[1:]:
            start = len(text[: effect.place.start].rstrip())
            edits.append(Edit(start, effect.place.end, ""))
        return edits

    def _outcomes(self, finding: StochasticEffect, known: set[str]) -> list[tuple[str, str]] | None:
        """Return share and effect of each outcome that the file does not have; None for others."""
        outcomes = []
        for outcome in finding.outcomes:
            if outcome.written or not outcome.changes:
                continue
            effects = []
            for name, change in outcome.changes:
                symbol, *terms = name.split()
                if not known.issuperset(terms) or outcome.like:
                    return None
                if self._syntax.declarations[symbol].numeric:
                    word = "increase" if change > 0 else "decrease"
                    effects.append(f"({word} ({name}) {plain(abs(change))})")
                else:
                    effects.append(f"({name})" if change > 0 else f"(not ({name}))")
            shown = effects[0] if len(effects) == 1 else f"(and {' '.join(effects)})"
            outcomes.append((_share(outcome.probability, outcome.error), shown))
        return outcomes

    def _number(self, finding: ParameterFinding) -> list[Edit]:
        """Return the edits that write a parameter below its evidence."""
        place, observed = finding.place, measured(finding.estimate, finding.error)
        if float(finding.number) == finding.written:
            return []
        self.changes.append(place.line)
        evidence = f"{place.text} as written; observed {observed} in {finding.samples:,} steps"
        number = Edit(place.start, place.end, finding.number)
        return [self._comment_above(place, evidence), number]

    def _additions(self) -> list[Edit]:
        """Return the edits that add missing effects, in the order of the declarations."""
        edits: list[Edit] = []
        by_action: dict[str, list[tuple[str, str]]] = {}
        order = {symbol: k for k, symbol in enumerate(self._syntax.declarations)}
        for missing in sorted(self._findings.missing, key=lambda m: order[symbol_of(m.fluent)]):
            terms = sorted(missing.terms, key=lambda term: (len(term.fluents), term.fluents))
            if (assignment := self._assignment(missing)) is not None:
                edits += self._into_assignment(assignment, missing, terms)
                continue
            line = self._place(missing.schema).line if missing.schema else self._last.line
            self.changes += [line] * len(terms)
            steps, per = f"{missing.samples:,} steps", "" if missing.schema else " per unit of time"
            effects = [
                (
                    f"found in {steps}: {measured(term.coefficient, term.error)}{per}",
                    missing.effect(term),
                )
                for term in terms
            ]
            if missing.schema:
                by_action.setdefault(missing.schema, []).extend(effects)
            else:
                edits.append(self._process(symbol_of(missing.fluent), effects))
        for name, effects in by_action.items():
            edits += self._effects_in(self._place(name), effects)
        return edits

    def _assignment(self, missing: MissingEffect) -> x.ChangeFunction | None:
        """Return the assignment of the fluent in the action, if there is one."""
        for schema in self._syntax.schemas:
            for node in x.nodes_in(schema.effects) if schema.name == missing.schema else ():
                if isinstance(node, x.ChangeFunction) and node.change is x.Change.ASSIGN:
                    terms = (node.function.name, *(term.name for term in node.function.arguments))
                    if " ".join(terms) == missing.fluent:
                        return node
        return None

    def _into_assignment(
        self, effect: x.ChangeFunction, missing: MissingEffect, terms: Sequence[EffectTerm]
    ) -> list[Edit]:
        """Return the edits that add terms to the value that is assigned."""
        self.changes.append(effect.place.line)
        old = effect.value.place
        evidence = f"{old.text} as written; more terms found in {missing.samples:,} steps"
        edits = [self._comment_above(effect.place, evidence)]
        for term in terms:  # the first one innermost
            sign = "-" if term.coefficient < 0 else "+"
            edits.insert(1, Edit(old.start, old.start, f"({sign} "))
            edits.append(Edit(old.end, old.end, f" {term.size})"))
        return edits

    def _effects_in(self, schema: Place, effects: Sequence[tuple[str, str]]) -> list[Edit]:
        """Return the edits that give an action further effects, each with its evidence."""
        group = next(g for g in self._groups if g.place.start == schema.start)
        value = next(
            (
                value
                for word, value in zip(group.items[2::2], group.items[3::2], strict=False)
                if isinstance(word, Word) and word.text == ":effect" and isinstance(value, Group)
            ),
            None,
        )
        base = indent_at(self._text, (value or group).place.start)
        if value is None:
            at = group.items[-1].place.end
            lines = self._lines(effects, base + "    ")
            return [Edit(at, at, f"{self._newline}{base}  :effect (and{lines})")]
        start, end = value.place.start, value.place.end
        lines = self._lines(effects, base + "  ")
        if not value.items:
            return [Edit(start, end, f"(and{lines})")]
        if value.head != "and":
            before = f"(and{lines}{self._newline}{base}  "
            return [Edit(start, start, before), Edit(end, end, ")")]
        # In front, because comments behind the last effect refer to it.
        at = self._behind(value.items[0].place)
        if self._text[at : line_end(self._text, at)].strip() and len(value.items) > 1:
            # The text before the first effect ends its indent.
            lines += self._newline + (base + "  ")[value.items[1].place.start - at :]
        return [Edit(at, at, lines)]

    def _process(self, symbol: str, effects: Sequence[tuple[str, str]]) -> Edit:
        """Return the edit that adds a process after the last one, or else the last action."""
        name, number = f"{symbol}-changes", 1
        while name in self._names:
            number += 1
            name = f"{symbol}-changes-{number}"
        self._names.add(name)
        parameters = " ".join(map(_declared, self._syntax.declarations[symbol].parameters))
        base, line = indent_at(self._text, self._last.start), self._newline
        text = (
            f"{line}{line}{base}(:process {name}{line}"
            f"{base}  :parameters ({parameters}){line}"
            f"{base}  :precondition (and){line}"
            f"{base}  :effect (and{self._lines(effects, base + '    ')}))"
        )
        at = self._behind(self._last)
        return Edit(at, at, text)

    @property
    def _last(self) -> Place:
        """Place of the last process, or else of the last action."""
        processes = [g.place for g in self._groups if g.head == ":process"]
        return (processes or [g.place for g in self._groups if g.head == ":action"])[-1]

    def _place(self, action: str) -> Place:
        schemas = self._syntax.schemas
        return next(s.place for s in schemas if s.kind is x.Kind.ACTION and s.name == action)

    def _behind(self, place: Place) -> int:
        """Return the position behind a place, and behind a comment that ends its line."""
        end = line_end(self._text, place.end)
        rest = self._text[place.end : end].strip()
        return end if not rest or rest.startswith(";") else place.end

    def _comment_above(self, place: Place, text: str) -> Edit:
        start = line_start(self._text, place.start)
        return Edit(start, start, self._comment(text, indent_at(self._text, place.start)))

    def _comment(self, text: str, indent: str) -> str:
        """Return comment lines, each with the indent and a line break at its end."""
        lines = textwrap.wrap(
            text.translate(_ASCII),
            max(40, 98 - len(indent)),
            break_long_words=False,
            break_on_hyphens=False,
        )
        return "".join(f"{indent}; {line}{self._newline}" for line in lines)

    def _lines(self, effects: Iterable[tuple[str, str]], indent: str) -> str:
        """Return effects below their evidence, each after a line break."""
        return "".join(
            f"{self._newline}{self._comment(evidence, indent)}{indent}{effect}"
            for evidence, effect in effects
        )


def _share(probability: float, error: float) -> str:
    """Return a probability as the file has it, with two to four decimals, rounded down."""
    digits = 2 if error > 0.005 and probability >= 0.01 else 4
    return f"{math.floor(probability * 10**digits) / 10**digits:g}"


def _declared(parameter: x.SchemaParameter) -> str:
    """Return a parameter as it is declared: `?r - robot`."""
    types = " ".join(parameter.types)
    if len(parameter.types) > 1:
        types = f"(either {types})"
    return parameter.name if types == x.OBJECT else f"{parameter.name} - {types}"
