"""Repair of a domain file by the findings of a run.

Parameters are changed in place, and missing effects are added to their action or as a process, each
with its evidence as a comment. Every other byte of the file is kept. Rewards, unsafe and terminal
are only commented on. `serp.diagnosis.relevance` decides which findings are written.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from serp.diagnosis.findings import (
    EffectTerm,
    Findings,
    MissingEffect,
    ParameterFinding,
    symbol_of,
)
from serp.diagnosis.relevance import CERTAIN
from serp.diagnosis.repair.effect_edit import EffectEdit
from serp.diagnosis.repair.formatting import (
    decimal,
    effect_of,
    evidence_of_outcomes,
    evidence_of_rule,
    evidence_of_term,
    measured,
)
from serp.diagnosis.repair.insertion import InsertionPoints
from serp.model.loading import Domain
from serp.pddl import syntax as x
from serp.pddl.edits import Edit, edited
from serp.pddl.source import Place, Source
from serp.sysid.lifted_features import WORLD

_NEARLY_ONE = 0.01
_HEAD = "Not explained by what serp observed"


@dataclass(frozen=True)
class Repair:
    """One change of a file.

    Attributes:
        line: Line of the file as it was; for an addition the line of what it is added to.
        schema: The action or process that is changed or new.
        before: The effect as it was; empty for an addition.
        after: The effect as it is now; empty if only a comment is added.
        evidence: The observation behind it.
    """

    line: int
    schema: str
    before: str
    after: str
    evidence: str


@dataclass(frozen=True)
class Repaired:
    """A repaired domain file.

    Attributes:
        text: The whole text.
        repairs: The changes, in the order of the file.
        open: Sentences about what is not repaired: quantities that the findings do not explain, and
            findings about the problem file. If there are changes, the head of the file lists them.
    """

    text: str
    repairs: tuple[Repair, ...]
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
    if not writer.repairs:
        return Repaired(domain.source.text, (), left)
    text = edited(domain.source.text, [*writer.head(left), *edits])
    _check(domain, text)
    return Repaired(text, tuple(sorted(writer.repairs, key=lambda r: r.line)), left)


def _check(domain: Domain, text: str) -> None:
    source = Source(f"{domain.source.name} (repaired)", text)
    limit = domain.max_ground_schemas
    Domain.parse(source, domain.problem_source, max_ground_schemas=limit).model  # noqa: B018


class _Writer:
    """Collects the edits of one file and notes the repairs."""

    def __init__(self, domain: Domain, findings: Findings) -> None:
        self.repairs: list[Repair] = []
        self.in_problem: list[str] = []
        self._findings = findings
        self._source = domain.source
        self._syntax = domain.syntax
        self._points = InsertionPoints(domain.source)
        self._effects = [
            EffectEdit(schema, effect)
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
        """Return all edits, and note the repairs."""
        for finding in self._findings.parameters:
            if finding.parameter.place.source is self._source:
                self._change(finding)
            else:
                place, found = finding.parameter.place, measured(finding.estimate, finding.error)
                where = f"{Path(place.source.name).name}, line {place.line}"
                self.in_problem.append(f"{where}: {place.text} as written; observed {found}")
        edits = self._additions()
        for rule in self._findings.rules:
            if rule.place is not None and rule.place.source is self._source:
                edits += self._comment(rule.place, rule.schema, [evidence_of_rule(rule)])
        for effect in self._findings.stochastic:
            edits += self._comment(effect.place, effect.schema, evidence_of_outcomes(effect))
        for edit in self._effects:
            edits += edit.edits() + self._evidence_edits(edit)
        return edits + self._points.requirements(self._needs)

    def head(self, left: Sequence[str]) -> list[Edit]:
        """Return the edits that list, at the head of the file, what is not repaired."""
        steps = f"{self._findings.samples:,} steps"
        return self._points.head(f"{_HEAD}, in {steps}:", left)

    def _comment(self, place: Place, schema: str, lines: Sequence[str]) -> list[Edit]:
        """Return the edits that put comments above a place, and note the repair."""
        evidence = " ".join(line.strip() for line in lines)
        self.repairs.append(Repair(place.line, schema, "", "", evidence))
        return [self._points.comment_above(place.start, line) for line in lines]

    def _evidence_edits(self, edit: EffectEdit) -> list[Edit]:
        """Return the comments on the changes of an effect as edits, and note the repair."""
        if edit.evidence:
            place, evidence = edit.effect.place, "; ".join(text for _, text in edit.evidence)
            self.repairs.append(
                Repair(place.line, edit.schema.name, place.text, edit.text, evidence)
            )
        return [self._points.comment_above(place.start, text) for place, text in edit.evidence]

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
                if terms:
                    edits.append(self._process(missing, terms))
                continue
            terms = self._into_assignment(missing, terms)
            if terms:
                place = self._schema(missing.schema).place
                effects = self._written(missing, terms, missing.schema, place.line)
                into.setdefault(missing.schema, []).extend(effects)
        for name, effects in into.items():
            edits += self._points.effects_in(self._schema(name).place, effects)
        return edits

    def _into_assignment(self, missing: MissingEffect, terms: list[EffectTerm]) -> list[EffectTerm]:
        """Write terms into the assignment of the fluent, if there is one; return the rest."""
        edit = next(
            (
                e
                for e in self._effects
                if e.schema.name == missing.schema
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
        name = self._new_name(f"{symbol}-changes")
        effects = self._written(missing, terms, name, self._points.last_schema.line)
        declared = self._syntax.declarations[symbol].parameters
        return self._points.process(name, _parameters(declared), effects)

    def _written(
        self, missing: MissingEffect, terms: Sequence[EffectTerm], schema: str, line: int
    ) -> list[tuple[str, str]]:
        """Return an effect for each term with its evidence, and note the repairs."""
        self._needs[":numeric-fluents"] = None
        rate = missing.rate
        effects = [
            (
                evidence_of_term(term, missing.samples, rate=rate),
                effect_of(missing.fluent, term, rate=rate),
            )
            for term in terms
        ]
        self.repairs += [Repair(line, schema, "", effect, evidence) for evidence, effect in effects]
        return effects

    def _schema(self, name: str) -> x.Schema:
        return next(s for s in self._syntax.schemas if s.kind is x.Kind.ACTION and s.name == name)

    def _new_name(self, wanted: str) -> str:
        name, number = wanted, 1
        while name in self._names:
            number += 1
            name = f"{wanted}-{number}"
        self._names.add(name)
        return name


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
        if parameter.types == (x.OBJECT,):
            written.append(parameter.name)
        elif len(parameter.types) == 1:
            written.append(f"{parameter.name} - {parameter.types[0]}")
        else:
            written.append(f"{parameter.name} - (either {' '.join(parameter.types)})")
    return " ".join(written)
