"""Repair of a domain file by the findings of a run.

Parameters are changed in place, and missing effects are added to their action or as a process, each
with its evidence as a comment. Every other byte of the file is kept. Rewards, unsafe and terminal
are only commented on. `serp.runs.diagnosis.accuracy` decides which findings are written.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from serp._util.text import measured
from serp.model.domain import Domain
from serp.model.learned.regression_data import WORLD
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
from serp.runs.diagnosis.accuracy import CERTAIN
from serp.runs.diagnosis.findings import (
    EffectTerm,
    Findings,
    MissingEffect,
    ParameterFinding,
    symbol_of,
)
from serp.runs.diagnosis.remarks import outcomes_text, rule_text

_DIGITS = 4  # most significant ones
_WIDTH = 100
_PLAIN = str.maketrans({"−": "-", "…": "...", "×": "*", "±": "+/-"})


def decimal(value: float, error: float) -> str:
    """Format a number up to the first uncertain digit, with at most four digits.

    A plain decimal, as every PDDL tool reads it: `0.21`, `-3`, never an exponent.

    Args:
        value: The number.
        error: Its standard error; 0 for none.
    """
    if value == 0.0:
        return "0"
    most = _DIGITS - 1 - math.floor(math.log10(abs(value)))
    decimals = most
    if error > 0.0 and math.isfinite(error):
        decimals = min(most, -math.floor(math.log10(error)))
    rounded = round(value, decimals)
    if rounded == 0.0:  # no digit is certain: show the order of magnitude
        decimals = -math.floor(math.log10(abs(value)))
        rounded = round(value, decimals)
    text = f"{rounded:.{max(0, decimals)}f}"
    if decimals == most and "." in text:
        text = text.rstrip("0").rstrip(".")
    return text


def effect_of(target: str, term: EffectTerm, *, rate: bool) -> str:
    """Return `(increase (f) ...)` or `(decrease (f) ...)` for one term.

    Args:
        target: Name of the fluent, `battery ?robot`.
        term: The term that changes it.
        rate: Whether it is a change per unit of time, as in a process.
    """
    value = _product(abs(term.coefficient), term)
    if rate:
        value = f"(* #t {value})"
    return f"({'decrease' if term.coefficient < 0 else 'increase'} ({target}) {value})"


def plus(value: str, terms: Iterable[EffectTerm]) -> str:
    """Return the expression of a value with terms added to it, in binary arithmetic."""
    for term in terms:
        operator = "-" if term.coefficient < 0 else "+"
        value = f"({operator} {value} {_product(abs(term.coefficient), term)})"
    return value


def _product(coefficient: float, term: EffectTerm) -> str:
    """Return a coefficient, which is not negative, times the fluents of a term."""
    number = decimal(coefficient, term.error)
    fluents = ""
    for name in term.fluents:
        fluents = f"(* {fluents} ({name}))" if fluents else f"({name})"
    if not fluents:
        return number
    return fluents if number == "1" else f"(* {number} {fluents})"


def comment(text: str, indent: str, newline: str) -> str:
    """Return comment lines, each with the indent and a line break at its end."""
    width = max(40, _WIDTH - len(indent) - 2)
    plain = text.translate(_PLAIN)
    lines = textwrap.wrap(plain, width, break_long_words=False, break_on_hyphens=False)
    return "".join(f"{indent}; {line}{newline}" for line in lines)


_OPPOSITE = {x.Change.INCREASE: x.Change.DECREASE, x.Change.DECREASE: x.Change.INCREASE}
_HEAD = re.compile(r"\(\s*([^\s();]+)")


class EffectEdit:
    """An effect on a number, and its edits.

    Attributes:
        schema: Name of the action or process that contains it.
        effect: The effect.
        evidence: Comments on the edits, each with the place above which it is inserted.
    """

    def __init__(self, schema: str, effect: x.ChangeFunction) -> None:
        self.schema = schema
        self.effect = effect
        self.evidence: list[tuple[Place, str]] = []
        self._change = effect.change
        self._numbers: dict[int, tuple[Place, str]] = {}
        self._added: tuple[EffectTerm, ...] = ()

    def set_number(self, place: Place, number: str) -> None:
        """Replace a number of the value."""
        self._numbers[place.start] = place, number

    def make_increase(self) -> None:
        """Turn an assignment into an increase by the assigned value."""
        self._change = x.Change.INCREASE
        value = self.effect.value
        if isinstance(value, x.Number):  # which may be negative
            self._numbers.setdefault(value.place.start, (value.place, value.place.text))

    def add_terms(self, terms: Sequence[EffectTerm]) -> None:
        """Add terms to the value of an assignment."""
        self._added = tuple(terms)

    def edits(self) -> list[Edit]:
        """Return the edits; a negative factor exchanges `increase` and `decrease`."""
        change = self._change
        edits = []
        for place, number in self._numbers.values():
            bare = number.removeprefix("-")
            if bare != number and change in _OPPOSITE and _is_factor(self.effect.value, place):
                change, number = _OPPOSITE[change], bare
            if number != place.text:
                edits.append(Edit(place.start, place.end, number))
        if change is not self.effect.change:
            source, start = self.effect.place.source, self.effect.place.start
            head = _HEAD.match(source.text, start)
            assert head is not None
            edits.append(Edit(head.start(1), head.end(1), change.value))
        if self._added:
            start, end = self.effect.value.place.start, self.effect.value.place.end
            before, after = plus("\n", self._added).split("\n")
            edits += [Edit(start, start, before), Edit(end, end, after)]
        return edits


def _is_factor(value: x.Expression, place: Place) -> bool:
    """Return whether a value is a number, or a product with it."""
    if isinstance(value, x.Number):
        return value.place.start == place.start
    return (
        isinstance(value, x.Arithmetic)
        and value.operator in ("*", "/")
        and any(_is_factor(operand, place) for operand in value.operands)
    )


_IMPLYING = {
    ":time": (":time", ":hybrid", ":processes", ":events", ":continuous-effects"),
    ":numeric-fluents": (":numeric-fluents", ":fluents", ":action-costs", ":hybrid"),
}


class InsertionPoints:
    """The text of one domain file.

    Args:
        source: The file; it was parsed without an error.

    Attributes:
        text: All of it.
    """

    def __init__(self, source: Source) -> None:
        self.text = source.text
        self._newline = newline_of(source.text)
        self._top = read_group(source)
        self._groups = [item for item in self._top.items if isinstance(item, Group)]

    def comment_above(self, position: int, text: str) -> Edit:
        """Return the edit that inserts comment lines above the line of a position."""
        start = line_start(self.text, position)
        return Edit(start, start, comment(text, indent_at(self.text, position), self._newline))

    def head(self, title: str, lines: Sequence[str]) -> list[Edit]:
        """Return the edits that put a list at the head of the file, replacing an older one.

        Args:
            title: Its first line; an older list is recognised by the words before the first comma.
            lines: The other lines; empty: no list.
        """
        end, mark = 0, f"; {title.partition(',')[0]}"
        if self.text.startswith(mark):
            end = self.text.find(self._newline * 2) + 2 * len(self._newline)
        written = "".join(comment(f"* {line}", "", self._newline) for line in lines)
        text = f"{comment(title, '', self._newline)}{written}{self._newline}" if lines else ""
        return [Edit(0, end, text)] if text or end else []

    def effects_in(self, schema: Place, effects: Sequence[tuple[str, str]]) -> list[Edit]:
        """Return the edits that give an action further effects.

        Args:
            schema: Where the action is written.
            effects: Each with its evidence, which is inserted above it as a comment.
        """
        group = next(g for g in self._groups if g.place.start == schema.start)
        value = _field(group, ":effect")
        base = indent_at(self.text, (value or group).place.start)
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
        at = value.items[0].place.end
        rest = self.text[at : line_end(self.text, at)].strip()
        if not rest or rest.startswith(";"):
            at = line_end(self.text, at)
        elif len(value.items) > 1:  # the text before the first effect ends its indent
            lines += self._newline + (base + "  ")[value.items[1].place.start - at :]
        return [Edit(at, at, lines)]

    def process(self, name: str, parameters: str, effects: Sequence[tuple[str, str]]) -> Edit:
        """Return the edit that adds a process, after the last one or else the last action.

        Args:
            name: Its name.
            parameters: As they are declared: `?r - robot`.
            effects: Each with its evidence.
        """
        anchor = self.last_schema
        base = indent_at(self.text, anchor.start)
        line = self._newline
        text = (
            f"{line}{line}{base}(:process {name}{line}"
            f"{base}  :parameters ({parameters}){line}"
            f"{base}  :precondition (and){line}"
            f"{base}  :effect (and{self._lines(effects, base + '    ')}))"
        )
        rest = self.text[anchor.end : line_end(self.text, anchor.end)].strip()
        at = anchor.end
        if not rest or rest.startswith(";"):
            at = line_end(self.text, anchor.end)
        return Edit(at, at, text)

    @property
    def last_schema(self) -> Place:
        """Place of the last process, or else of the last action."""
        processes = [g.place for g in self._groups if g.head == ":process"]
        return (processes or [g.place for g in self._groups if g.head == ":action"])[-1]

    def requirements(self, needs: Iterable[str]) -> list[Edit]:
        """Return the edits that add missing entries to `:requirements`."""
        section = next((g for g in self._groups if g.head == ":requirements"), None)
        listed = {word.text for word in section.items if isinstance(word, Word)} if section else ()
        missing = [need for need in needs if not set(_IMPLYING[need]) & set(listed)]
        if not missing:
            return []
        if section is not None:
            at = section.items[-1].place.end
            return [Edit(at, at, "".join(f" {need}" for need in missing))]
        at = self._top.items[1].place.end
        words = " ".join([":strips", *missing])
        return [Edit(at, at, f"{self._newline}  (:requirements {words})")]

    def _lines(self, effects: Sequence[tuple[str, str]], indent: str) -> str:
        """Return effects on separate lines, each after a line break."""
        return "".join(
            f"{self._newline}{comment(evidence, indent, self._newline)}{indent}{effect}"
            for evidence, effect in effects
        )


def _field(group: Group, key: str) -> Group | None:
    """Return the group that follows a key of a schema."""
    for word, value in zip(group.items[2::2], group.items[3::2], strict=False):
        if isinstance(word, Word) and word.text == key and isinstance(value, Group):
            return value
    return None


_NEARLY_ONE = 0.01
_HEAD_OF_REPAIR = "Not explained by what serp observed"


@dataclass(frozen=True)
class Repaired:
    """A repaired domain file.

    Attributes:
        text: The whole text.
        changes: For each effect or comment that is changed or new: the line of the file as it was;
            for an addition the line of what it is added to.
        open: Sentences about what is not repaired: quantities that the findings do not explain, and
            findings about the problem file. If there are changes, the head of the file lists them.
    """

    text: str
    changes: tuple[int, ...]
    open: tuple[str, ...] = ()


def repair(domain: Domain, findings: Findings, unexplained: Sequence[str] = ()) -> Repaired:
    """Return the domain file with findings written into it.

    Parameters are changed and missing effects are added; findings on stochastic effects, rewards
    and ends become comments. The result has been parsed and instantiated.

    Args:
        domain: The domain; its problem file is not changed.
        findings: The findings to write.
        unexplained: Sentences about quantities that the findings do not explain.

    Raises:
        DomainError: The repaired file and the problem would not be valid.
    """
    writer = _Writer(domain, findings)
    edits = writer.edits()
    left = (*unexplained, *writer.in_problem)
    if not writer.changes:
        return Repaired(domain.source.text, (), left)
    head = writer.points.head(f"{_HEAD}, in {findings.samples:,} steps:", left)
    text = edited(domain.source.text, [*head, *edits])
    source = Source(f"{domain.source.name} (repaired)", text)
    limit = domain.max_ground_schemas
    Domain.parse(source, domain.problem_source, max_ground_schemas=limit).model  # noqa: B018
    return Repaired(text, tuple(sorted(writer.changes)), left)


class _Writer:
    """Collects the edits of one file and the lines that they change."""

    def __init__(self, domain: Domain, findings: Findings) -> None:
        self.changes: list[int] = []
        self.in_problem: list[str] = []
        self.points = InsertionPoints(domain.source)
        self._findings = findings
        self._domain = domain
        self._syntax = domain.syntax
        self._effects = [
            EffectEdit(schema.name, effect)
            for schema in domain.syntax.schemas
            for effect in _changes(schema.effects)
        ]
        self._needs: dict[str, None] = {}
        self._names = {
            *(s.name for s in domain.syntax.schemas),
            *domain.syntax.declarations,
            *domain.syntax.constants,
            *domain.syntax.parents,
        }

    def edits(self) -> list[Edit]:
        """Return all edits, and note the lines that they change."""
        source = self._domain.source
        for finding in self._findings.parameters:
            place = finding.parameter.place
            if place.source is source:
                self._change(finding)
            else:
                found = measured(finding.estimate, finding.error)
                where = f"{Path(place.source.name).name}, line {place.line}"
                self.in_problem.append(f"{where}: {place.text} as written; observed {found}")
        edits = self._additions()
        comments: list[tuple[Place | None, str]]
        comments = [(r.place, rule_text(r)) for r in self._findings.rules]
        comments += [
            (e.place, outcomes_text(e, self._domain.model.ground))
            for e in self._findings.stochastic
        ]
        for at, text in comments:
            if at is not None and at.source is source:
                self.changes.append(at.line)
                edits.append(self.points.comment_above(at.start, f"Observed: {text}."))
        for edit in self._effects:
            if edit.evidence:
                self.changes.append(edit.effect.place.line)
            edits += edit.edits()
            edits += [self.points.comment_above(p.start, text) for p, text in edit.evidence]
        return edits + self.points.requirements(self._needs)

    def _change(self, finding: ParameterFinding) -> None:
        place = finding.parameter.place
        number = decimal(finding.estimate, finding.error)
        turned = finding.estimate * finding.written < 0.0
        if turned and abs(finding.estimate) <= CERTAIN * finding.error:
            number = "0"  # its sign is uncertain
        if float(number) == finding.written:
            return
        edit = next(
            e
            for e in self._effects
            if e.effect.place.start <= place.start and place.end <= e.effect.place.end
        )
        edit.set_number(place, number)
        observed = measured(finding.estimate, finding.error)
        evidence = f"{place.text} as written; observed {observed} in {finding.samples:,} steps"
        edit.evidence.append((place, evidence))

    def _additions(self) -> list[Edit]:
        """Return the edits that add missing effects, in the order of the declarations."""
        edits: list[Edit] = []
        into: dict[str, list[tuple[str, str]]] = {}
        order = {symbol: k for k, symbol in enumerate(self._syntax.declarations)}
        for missing in sorted(self._findings.missing, key=lambda m: order[symbol_of(m.fluent)]):
            terms = sorted(missing.terms, key=lambda term: (len(term.fluents), term.fluents))
            if missing.schema == WORLD:
                edits += [self._process(missing, terms)] if terms else []
                continue
            terms = self._into_assignment(missing, terms)
            if terms:
                effects = self._written(missing, terms, self._place(missing.schema).line)
                into.setdefault(missing.schema, []).extend(effects)
        for name, effects in into.items():
            edits += self.points.effects_in(self._place(name), effects)
        return edits

    def _into_assignment(self, missing: MissingEffect, terms: list[EffectTerm]) -> list[EffectTerm]:
        """Write terms into the assignment of the fluent, if there is one; return the rest."""
        edit = next(
            (
                e
                for e in self._effects
                if e.schema == missing.schema
                and e.effect.change is x.Change.ASSIGN
                and _name_of(e.effect.function) == missing.fluent
            ),
            None,
        )
        if edit is None or not terms:
            return terms
        own = [t for t in terms if t.fluents == (missing.fluent,)]
        steps = f"{missing.samples:,} steps"
        if own and abs(own[0].coefficient - 1.0) <= _NEARLY_ONE:
            # The old value plus a change is an increase.
            edit.make_increase()
            rest = [t for t in terms if t not in own]
            evidence = f"in {steps} it was added to the old value"
        else:
            edit.add_terms(terms)
            evidence, rest = f"further terms found in {steps}", []
        edit.evidence.append((edit.effect.place, f"assigned as written; {evidence}"))
        return rest

    def _process(self, missing: MissingEffect, terms: Sequence[EffectTerm]) -> Edit:
        self._needs[":time"] = None
        symbol = symbol_of(missing.fluent)
        name, number = f"{symbol}-changes", 1
        while name in self._names:
            number += 1
            name = f"{symbol}-changes-{number}"
        self._names.add(name)
        effects = self._written(missing, terms, self.points.last_schema.line)
        declared = self._syntax.declarations[symbol].parameters
        return self.points.process(name, _parameters(declared), effects)

    def _written(
        self, missing: MissingEffect, terms: Sequence[EffectTerm], line: int
    ) -> list[tuple[str, str]]:
        """Return an effect for each term with its evidence, and note the changes."""
        self._needs[":numeric-fluents"] = None
        self.changes += [line] * len(terms)
        found = f"found in {missing.samples:,} steps: "
        per = " per unit of time" if missing.rate else ""
        return [
            (
                f"{found}{measured(term.coefficient, term.error)}{per}",
                effect_of(missing.fluent, term, rate=missing.rate),
            )
            for term in terms
        ]

    def _place(self, action: str) -> Place:
        schemas = self._syntax.schemas
        return next(s.place for s in schemas if s.kind is x.Kind.ACTION and s.name == action)


def _changes(effects: Sequence[x.Effect]) -> Iterator[x.ChangeFunction]:
    """Yield the numeric effects, those under `when` and `forall` too."""
    for effect in effects:
        if isinstance(effect, x.ChangeFunction):
            yield effect
        elif isinstance(effect, x.When | x.ForallEffect):
            yield from _changes(effect.effects)


def _name_of(function: x.FunctionTerm) -> str:
    return " ".join((function.name, *(term.name for term in function.arguments)))


def _parameters(parameters: Sequence[x.SchemaParameter]) -> str:
    """Return parameters as they are declared: `?r - robot`."""
    written = []
    for parameter in parameters:
        types = " ".join(parameter.types)
        if len(parameter.types) > 1:
            types = f"(either {types})"
        written.append(parameter.name if types == x.OBJECT else f"{parameter.name} - {types}")
    return " ".join(written)
