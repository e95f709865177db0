"""Repair of a domain file by the findings of a run.

Parameters are changed in place, and missing effects are added to their action or as a process, each
with its evidence as a comment. Every other byte of the file is kept. Rewards, unsafe and terminal
are only commented on. `serp.diagnosis.relevance` decides which findings are written.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from serp._util.number_format import measured
from serp.diagnosis.findings import (
    EffectTerm,
    Findings,
    MissingEffect,
    ParameterFinding,
    symbol_of,
)
from serp.diagnosis.relevance import CERTAIN
from serp.diagnosis.remarks import outcomes_text, rule_text
from serp.diagnosis.repair.effect_edit import EffectEdit
from serp.diagnosis.repair.formatting import decimal, effect_of
from serp.diagnosis.repair.insertion import InsertionPoints
from serp.model.loading import Domain
from serp.pddl import syntax as x
from serp.pddl.edits import Edit, edited
from serp.pddl.source import Place, Source
from serp.sysid.lifted_features import WORLD

_NEARLY_ONE = 0.01
_HEAD = "Not explained by what serp observed"


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
