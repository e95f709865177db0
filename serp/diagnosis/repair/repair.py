"""Writing back into a domain file what a run has found out.

The result is the expert's own file: literals are changed where they stand, effects are added where
they belong, each with its evidence as a comment; every other byte stays. What is good, unsafe or
an end is never touched, only commented on. What to write is decided in `serp.diagnosis.relevance`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from serp.diagnosis.findings import EffectTerm, Findings, MissingEffect, ParameterFinding
from serp.diagnosis.repair.effect_edit import AmendedEffect
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
from serp.pddl.parser import parse_domain, parse_problem
from serp.pddl.source import Place, Source
from serp.sysid.lifted_features import WORLD

_CERTAIN = 4.0  # standard errors
_NEARLY_ONE = 0.01
_HEAD = "Not explained by what serp observed"


@dataclass(frozen=True)
class Repair:
    """One change of a file, for people.

    Attributes:
        line: Line of the file as it was; where something is added, of what it is added to.
        schema: The action or process that is changed or new.
        before: The effect that stood there; empty for something new.
        after: The effect that stands there now; empty for a mere comment.
        evidence: What was observed.
    """

    line: int
    schema: str
    before: str
    after: str
    evidence: str


@dataclass(frozen=True)
class Repaired:
    """A domain file once it is repaired.

    Attributes:
        text: All of it.
        repairs: What was changed, in the order of the file.
        open: Sentences about what was not: what nobody can explain, and what is found of the
            problem file. Where anything was changed they stand at the head of the file.
    """

    text: str
    repairs: tuple[Repair, ...]
    open: tuple[str, ...] = ()


def repair(domain: Domain, findings: Findings, unexplained: Sequence[str] = ()) -> Repaired:
    """Return the domain file with all findings written into it.

    Literals are changed, missing effects are added, and chance, rewards and ends are told in
    comments. The result was parsed and instantiated.

    Args:
        domain: The domain; its problem file is not touched.
        findings: What a run has found, and what of it is worth writing.
        unexplained: Sentences about what it has not.

    Raises:
        DomainError: The repaired file with the problem would be wrong.
    """
    work = _Work(domain, findings)
    edits = work.edits()
    left = (*unexplained, *work.elsewhere)
    if not work.repairs:
        return Repaired(domain.source.text, (), left)
    text = edited(domain.source.text, [*work.head(left), *edits])
    _check(domain, text)
    return Repaired(text, tuple(sorted(work.repairs, key=lambda r: r.line)), left)


def _check(domain: Domain, text: str) -> None:
    source = Source(f"{domain.source.name} (repaired)", text)
    syntax = parse_domain(source)
    problem = domain.problem_source
    parsed = parse_problem(problem, syntax) if problem is not None else None
    Domain(syntax.name, source, problem, syntax, parsed, domain.max_ground_schemas).model  # noqa: B018


class _Work:
    """One repair under way."""

    def __init__(self, domain: Domain, findings: Findings) -> None:
        self.repairs: list[Repair] = []
        self.elsewhere: list[str] = []
        self._findings = findings
        self._source = domain.source
        self._syntax = domain.syntax
        self._layout = InsertionPoints(domain.source)
        self._effects = [
            AmendedEffect(schema, effect)
            for schema in domain.syntax.schemas
            for effect in _changes(schema.effects)
        ]
        self._evidence: list[tuple[AmendedEffect, Place, str]] = []
        self._needs: dict[str, None] = {}
        self._names = {
            *(s.name for s in domain.syntax.schemas),
            *domain.syntax.declarations,
            *domain.syntax.constants,
            *domain.syntax.parents,
        }

    def edits(self) -> list[Edit]:
        """Return all edits, and note the repairs."""
        for literal in self._findings.literals:
            if literal.parameter.place.source is self._source:
                self._change(literal)
            else:
                place, found = literal.parameter.place, measured(literal.estimate, literal.error)
                where = f"{Path(place.source.name).name}, line {place.line}"
                self.elsewhere.append(f"{where}: {place.text} as written; observed {found}")
        edits = self._additions()
        for rule in self._findings.rules:
            if rule.place is not None and rule.place.source is self._source:
                edits += self._comment(rule.place, rule.schema, [evidence_of_rule(rule)])
        for outcome in self._findings.outcomes:
            edits += self._comment(outcome.place, outcome.schema, evidence_of_outcomes(outcome))
        for amended in self._effects:
            edits += amended.edits() + self._told(amended)
        return edits + self._layout.requirements(self._needs)

    def head(self, left: Sequence[str]) -> list[Edit]:
        """Return the edits that say at the head of the file what is not mended."""
        steps = f"{self._findings.samples:,} steps"
        return self._layout.head(f"{_HEAD}, in {steps}:", left)

    def _comment(self, place: Place, schema: str, lines: Sequence[str]) -> list[Edit]:
        """Return the edits that put comments above a place, and note the repair."""
        told = " ".join(line.strip() for line in lines)
        self.repairs.append(Repair(place.line, schema, "", "", told))
        return [self._layout.comment_above(place.start, line) for line in lines]

    # What stands in the file ---------------------------------------------------------------------

    def _told(self, amended: AmendedEffect) -> list[Edit]:
        """Return the evidence for what is changed in an effect as edits, and note the repair."""
        told = [(place, evidence) for a, place, evidence in self._evidence if a is amended]
        if told:
            before, after = amended.effect.place.text, amended.text
            evidence = "; ".join(text for _, text in told)
            line = amended.effect.place.line
            self.repairs.append(Repair(line, amended.schema.name, before, after, evidence))
        return [self._layout.comment_above(place.start, text) for place, text in told]

    def _change(self, finding: ParameterFinding) -> None:
        place = finding.parameter.place
        number = decimal(finding.estimate, finding.error)
        turned = finding.estimate * finding.written < 0.0
        if turned and abs(finding.estimate) <= _CERTAIN * finding.error:
            number = "0"  # nothing is left of the effect, rather than its opposite
        if float(number) == finding.written:
            return
        amended = next(
            a
            for a in self._effects
            if a.effect.place.start <= place.start and place.end <= a.effect.place.end
        )
        amended.set_number(place, number)
        observed = measured(finding.estimate, finding.error)
        evidence = f"{place.text} as written; observed {observed} in {finding.samples:,} steps"
        self._evidence.append((amended, place, evidence))

    # What does not -------------------------------------------------------------------------------

    def _additions(self) -> list[Edit]:
        """Return the edits that add what is missing, in the order in which fluents are declared."""
        edits: list[Edit] = []
        into: dict[str, list[tuple[str, str]]] = {}
        order = list(self._syntax.declarations)
        for missing in sorted(self._findings.missing, key=lambda m: order.index(_symbol(m.fluent))):
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
            edits += self._layout.effects_in(self._schema(name).place, effects)
        return edits

    def _into_assignment(self, missing: MissingEffect, terms: list[EffectTerm]) -> list[EffectTerm]:
        """Write terms into the assignment of the fluent, if there is one; return the rest."""
        amended = next(
            (
                a
                for a in self._effects
                if a.schema.name == missing.schema
                and a.effect.change is x.Change.ASSIGN
                and _name_of(a.effect.function) == missing.fluent
            ),
            None,
        )
        if amended is None or not terms:
            return terms
        own = [t for t in terms if t.fluents == (missing.fluent,)]
        steps = f"{missing.samples:,} steps"
        if own and abs(own[0].coefficient - 1.0) <= _NEARLY_ONE:
            # What it was before, plus something: that is an increase.
            amended.adds()
            told, rest = f"found to be added in {steps}", [t for t in terms if t not in own]
        else:
            amended.add(terms)
            told, rest = f"found to be that and more in {steps}", []
        evidence = f"assigned as written; {told}"
        self._evidence.append((amended, amended.effect.place, evidence))
        return rest

    def _process(self, missing: MissingEffect, terms: Sequence[EffectTerm]) -> Edit:
        self._needs[":time"] = None
        symbol = _symbol(missing.fluent)
        name = self._new_name(f"{symbol}-changes")
        effects = self._written(missing, terms, name, self._layout.last_schema.line)
        declared = self._syntax.declarations[symbol].parameters
        return self._layout.process(name, _parameters(declared), effects)

    def _written(
        self, missing: MissingEffect, terms: Sequence[EffectTerm], schema: str, line: int
    ) -> list[tuple[str, str]]:
        """Return an effect for each term with its evidence, and note the repairs."""
        self._needs[":numeric-fluents"] = None
        rate = missing.schema == WORLD
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


def _symbol(fluent: str) -> str:
    return fluent.split(" ")[0]


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
