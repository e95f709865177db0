"""Repair of a domain file by the findings of a run.

Parameters are changed in place, and missing effects are added to their action or as a process, each
with its evidence as a comment. Every other byte of the file is kept. Rewards, unsafe and terminal
are only commented on. `serp.runs.diagnosis.accuracy` decides which findings are written.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from serp._util.text import measured
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
    symbol_of,
)
from serp.runs.diagnosis.remarks import outcomes_text, rule_text

_ASCII = str.maketrans({"−": "-", "…": "...", "×": "*", "±": "+/-"})
_HEAD = "Not explained by what serp observed"
_IMPLYING = {
    ":numeric-fluents": {":numeric-fluents", ":fluents", ":action-costs", ":hybrid"},
    ":time": {":time", ":hybrid", ":processes", ":events", ":continuous-effects"},
}
"""Requirement → the requirements that imply it."""


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
    text = edited(domain.source.text, [*writer.head(left), *edits])
    source = Source(f"{domain.source.name} (repaired)", text)
    limit = domain.max_ground_schemas
    Domain.parse(source, domain.problem_source, max_ground_schemas=limit).model  # noqa: B018
    return Repaired(text, tuple(sorted(writer.changes)), left)


@dataclass
class _EffectEdit:
    """An effect on a number in a schema, and its edits; comments go above places inside it."""

    schema: str
    effect: x.ChangeFunction
    change: x.Change
    evidence: list[tuple[Place, str]] = field(default_factory=list)
    numbers: dict[Place, str] = field(default_factory=dict)
    added: Sequence[EffectTerm] = ()

    def edits(self) -> list[Edit]:
        """Return the edits; a negative factor exchanges `increase` and `decrease`."""
        change, effect = self.change, self.effect
        opposite = {x.Change.INCREASE: x.Change.DECREASE, x.Change.DECREASE: x.Change.INCREASE}
        edits = []
        for place, number in self.numbers.items():
            if number.startswith("-") and change in opposite and _is_factor(effect.value, place):
                change, number = opposite[change], number.removeprefix("-")
            if number != place.text:
                edits.append(Edit(place.start, place.end, number))
        if change is not effect.change:
            head = re.compile(r"\(\s*([^\s();]+)").match(
                effect.place.source.text, effect.place.start
            )
            assert head is not None
            edits.append(Edit(head.start(1), head.end(1), change.value))
        start, end = effect.value.place.start, effect.value.place.end
        for term in self.added:  # the first one innermost
            sign = "-" if term.coefficient < 0 else "+"
            edits.insert(0, Edit(start, start, f"({sign} "))
            edits.append(Edit(end, end, f" {term.size})"))
        return edits


def _is_factor(value: x.Expression, place: Place) -> bool:
    """Return whether a value is the number at a place, or a product with it."""
    if isinstance(value, x.Number):
        return value.place == place
    return (
        isinstance(value, x.Arithmetic)
        and value.operator in ("*", "/")
        and any(_is_factor(operand, place) for operand in value.operands)
    )


class _Writer:
    """Collects the edits of one file and the lines that they change.

    Attributes:
        changes: The changed lines.
        in_problem: Sentences about findings in the problem file.
    """

    def __init__(self, domain: Domain, findings: Findings) -> None:
        self.changes: list[int] = []
        self.in_problem: list[str] = []
        self._findings = findings
        self._domain = domain
        self._syntax = domain.syntax
        self._text = domain.source.text
        self._newline = newline_of(self._text)
        self._top = read_group(domain.source)
        self._groups = [item for item in self._top.items if isinstance(item, Group)]
        self._effects = [
            _EffectEdit(schema.name, effect, effect.change)
            for schema in self._syntax.schemas
            for effect in _changes(schema.effects)
        ]
        self._needs: set[str] = set()
        self._names = {
            *(schema.name for schema in self._syntax.schemas),
            *self._syntax.declarations,
            *self._syntax.constants,
            *self._syntax.parents,
        }

    def edits(self) -> list[Edit]:
        """Return all edits, and note the lines that they change."""
        source, findings = self._domain.source, self._findings
        for finding in findings.parameters:
            self._set_parameter(finding)
        edits = self._additions()
        ground = self._domain.model.ground
        comments = [(rule.place, rule_text(rule)) for rule in findings.rules]
        comments += [(e.place, outcomes_text(e, ground)) for e in findings.stochastic]
        for place, text in comments:
            if place is not None and place.source is source:
                self.changes.append(place.line)
                edits.append(self._comment_above(place, f"Observed: {text}."))
        for effect in self._effects:
            if effect.evidence:
                self.changes.append(effect.effect.place.line)
            edits += effect.edits()
            edits += [self._comment_above(place, text) for place, text in effect.evidence]
        return edits + self._requirements()

    def head(self, lines: Sequence[str]) -> list[Edit]:
        """Return the edits that put a list at the head of the file, replacing an older one."""
        end, text = 0, ""
        if self._text.startswith(f"; {_HEAD}"):
            end = self._text.find(self._newline * 2) + 2 * len(self._newline)
        if lines:
            title = f"{_HEAD}, in {self._findings.samples:,} steps:"
            items = (self._comment(item, "") for item in (title, *(f"* {line}" for line in lines)))
            text = "".join(items) + self._newline
        return [Edit(0, end, text)] if text or end else []

    def _set_parameter(self, finding: ParameterFinding) -> None:
        place = finding.parameter.place
        observed = measured(finding.estimate, finding.error)
        if place.source is not self._domain.source:
            where = f"{Path(place.source.name).name}, line {place.line}"
            self.in_problem.append(f"{where}: {place.text} as written; observed {observed}")
        elif float(finding.number) != finding.written:
            edit = next(e for e in self._effects if place.within(e.effect.place))
            edit.numbers[place] = finding.number
            evidence = f"{place.text} as written; observed {observed} in {finding.samples:,} steps"
            edit.evidence.append((place, evidence))

    def _additions(self) -> list[Edit]:
        """Return the edits that add missing effects, in the order of the declarations."""
        edits: list[Edit] = []
        by_action: dict[str, list[tuple[str, str]]] = {}
        order = {symbol: k for k, symbol in enumerate(self._syntax.declarations)}
        for missing in sorted(self._findings.missing, key=lambda m: order[symbol_of(m.fluent)]):
            terms = sorted(missing.terms, key=lambda term: (len(term.fluents), term.fluents))
            if missing.schema:
                terms = self._into_assignment(missing, terms)
            if not terms:
                continue
            line = self._place(missing.schema).line if missing.schema else self._last.line
            self.changes += [line] * len(terms)
            self._needs.add(":numeric-fluents")
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

    def _into_assignment(self, missing: MissingEffect, terms: list[EffectTerm]) -> list[EffectTerm]:
        """Write terms into the assignment of the fluent, if there is one; return the rest."""
        for edit in self._effects:
            function = edit.effect.function
            name = " ".join((function.name, *(term.name for term in function.arguments)))
            if (edit.schema, edit.effect.change, name) == (
                missing.schema, x.Change.ASSIGN, missing.fluent
            ):  # fmt: skip
                break
        else:
            return terms
        steps, value = f"{missing.samples:,} steps", edit.effect.value
        own = [t for t in terms if t.fluents == (missing.fluent,)]
        if own and abs(own[0].coefficient - 1.0) <= 0.01:
            # The old value plus a change is an increase.
            edit.change = x.Change.INCREASE
            if isinstance(value, x.Number):  # which may be negative
                edit.numbers.setdefault(value.place, value.place.text)
            rest = [t for t in terms if t not in own]
            evidence = f"in {steps} it was added to the old value"
        else:
            edit.added, rest = terms, []
            evidence = f"further terms found in {steps}"
        edit.evidence.append((edit.effect.place, f"assigned as written; {evidence}"))
        return rest

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
        self._needs.add(":time")
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

    def _requirements(self) -> list[Edit]:
        """Return the edits that add missing entries to `:requirements`."""
        section = next((g for g in self._groups if g.head == ":requirements"), None)
        listed = {word.text for word in section.items if isinstance(word, Word)} if section else ()
        missing = [n for n in _IMPLYING if n in self._needs and not _IMPLYING[n] & set(listed)]
        if not missing:
            return []
        if section is not None:
            at = section.items[-1].place.end
            return [Edit(at, at, "".join(f" {need}" for need in missing))]
        at = self._top.items[1].place.end
        return [Edit(at, at, f"{self._newline}  (:requirements {' '.join([':strips', *missing])})")]

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


def _changes(effects: Sequence[x.Effect]) -> Iterator[x.ChangeFunction]:
    """Yield the numeric effects, those under `when` and `forall` too."""
    for effect in effects:
        if isinstance(effect, x.ChangeFunction):
            yield effect
        elif isinstance(effect, x.When | x.ForallEffect):
            yield from _changes(effect.effects)


def _declared(parameter: x.SchemaParameter) -> str:
    """Return a parameter as it is declared: `?r - robot`."""
    types = " ".join(parameter.types)
    if len(parameter.types) > 1:
        types = f"(either {types})"
    return parameter.name if types == x.OBJECT else f"{parameter.name} - {types}"
