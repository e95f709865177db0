"""Rule: what a domain uses and does not list under `:requirements`."""

from __future__ import annotations

from collections.abc import Iterator

from serp.lint.subject import LintSubject
from serp.pddl import syntax as x
from serp.pddl.sexpr import Word
from serp.pddl.source import DomainWarning

_ADL = (":typing", ":negative-preconditions", ":disjunctive-preconditions", ":equality",
        ":quantified-preconditions", ":conditional-effects")  # fmt: skip
_IMPLIED = {
    ":adl": _ADL,
    ":quantified-preconditions": (":existential-preconditions", ":universal-preconditions"),
    ":action-costs": (":numeric-fluents",),
    ":fluents": (":numeric-fluents",),
    ":numeric-fluents": (":fluents",),
    ":hybrid": (":time", ":numeric-fluents"),
    ":processes": (":time",),
    ":events": (":time",),
    ":continuous-effects": (":time",),
}


def _missing_requirements(subject: LintSubject) -> Iterator[DomainWarning]:
    section = next(subject.sections(":requirements"), None)
    listed = {word.text for word in section.items if isinstance(word, Word)} if section else set()
    declared = set(listed)
    while more := {i for d in declared for i in _IMPLIED.get(d, ())} - declared:
        declared |= more
    missing = [need for need in _needs(subject.domain.syntax) if need not in declared]
    if missing:
        place = section.place if section else subject.domain.syntax.place
        why = " (processes and events need it)" if ":time" in missing else ""
        yield DomainWarning(
            f"used, but not among the :requirements: {' '.join(missing)}{why}", place
        )


def _needs(syntax: x.DomainSyntax) -> list[str]:
    """Return the requirements that a domain makes use of."""
    found: dict[str, None] = {}
    parameters = [
        *(p for s in syntax.schemas for p in s.parameters),
        *(p for d in syntax.declarations.values() for p in d.parameters),
    ]
    if syntax.parents or any(p.types != (x.OBJECT,) for p in parameters):
        found[":typing"] = None
    if any(d.numeric for d in syntax.declarations.values()):
        found[":numeric-fluents"] = None
    if any(s.kind is not x.Kind.ACTION for s in syntax.schemas):
        found[":time"] = None
    for schema in syntax.schemas:
        if schema.precondition is not None:
            found.update(dict.fromkeys(_of_condition(schema.precondition)))
        found.update(dict.fromkeys(_of_effects(schema.effects)))
    return list(found)


def _of_condition(condition: x.Condition) -> Iterator[str]:
    match condition:
        case x.SameObject():
            yield ":equality"
        case x.Connective(operator, operands):
            if operator == "not" and not isinstance(operands[0], x.SameObject):
                yield ":negative-preconditions"
            if operator in ("or", "imply"):
                yield ":disjunctive-preconditions"
            for operand in operands:
                yield from _of_condition(operand)
        case x.Quantified(operator, _, body):
            yield (
                ":existential-preconditions"
                if operator == "exists"
                else (":universal-preconditions")
            )
            yield from _of_condition(body)


def _of_effects(effects: tuple[x.Effect, ...]) -> Iterator[str]:
    for effect in effects:
        match effect:
            case x.When(condition, inner):
                yield ":conditional-effects"
                yield from _of_condition(condition)
                yield from _of_effects(inner)
            case x.ForallEffect(_, inner):
                yield ":conditional-effects"
                yield from _of_effects(inner)


RULES = {"missing-requirement": _missing_requirements}
