"""Rules: what a domain uses and does not list under `:requirements`, and the other way round."""

from __future__ import annotations

from collections.abc import Iterator

from serp.lint.subject import SCHEMAS, LintSubject, groups_in, words_in
from serp.pddl import syntax as x
from serp.pddl.edits import Edit, Fix
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
        why = " (processes and events need `:time`)" if ":time" in missing else ""
        fix = None
        if section is not None:
            fix = Fix((Edit(place.end - 1, place.end - 1, f" {' '.join(missing)}"),))
        text = f"used, but not among the :requirements: {' '.join(missing)}{why}"
        yield DomainWarning(text, place.opening, fix=fix)


def _unused_extension(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find the requirement that makes a file unreadable for other tools, and that it can go."""
    declarations = subject.domain.syntax.declarations
    sections = subject.sections(*SCHEMAS, ":goal", ":metric")
    numeric = {name for name, declared in declarations.items() if declared.numeric}
    used = {group.head for section in sections for group in groups_in(section)}
    if used & (x.MATH_FUNCTIONS.keys() - numeric):
        return
    for section in subject.sections(":requirements"):
        for word in words_in(section):
            if word.text == x.MATH_REQUIREMENT:
                yield DomainWarning(
                    f"`{word.text}` is listed and nothing needs it; without it, other tools can "
                    "read the file",
                    word.place,
                    fix=Fix((_without(word),)),
                )


def _without(word: Word) -> Edit:
    """Return the edit that leaves a word out, and the blank before it."""
    text, start = word.place.source.text, word.place.start
    return Edit(len(text[:start].rstrip(" ")), word.place.end, "")


def _needs(syntax: x.DomainSyntax) -> dict[str, None]:
    """Return the requirements that a domain makes use of, in order."""
    parameters = [p for s in syntax.schemas for p in s.parameters]
    parameters += [p for d in syntax.declarations.values() for p in d.parameters]
    general = {
        ":typing": syntax.parents or any(p.types != (x.OBJECT,) for p in parameters),
        ":numeric-fluents": any(d.numeric for d in syntax.declarations.values()),
        ":time": any(s.kind is not x.Kind.ACTION for s in syntax.schemas),
    }
    found = {need: None for need, used in general.items() if used}
    for schema in syntax.schemas:
        for condition in x.conditions_of(schema):
            found.update(dict.fromkeys(_of_condition(condition)))
        if any(isinstance(e, x.When | x.ForallEffect) for e in schema.effects):
            found[":conditional-effects"] = None
    return found


def _of_condition(condition: x.Condition) -> Iterator[str]:
    match condition:
        case x.SameObject():
            yield ":equality"
        case x.Connective("not", (operand,)) if not isinstance(operand, x.SameObject):
            yield ":negative-preconditions"
        case x.Connective("or" | "imply"):
            yield ":disjunctive-preconditions"
        case x.Quantified("exists"):
            yield ":existential-preconditions"
        case x.Quantified():
            yield ":universal-preconditions"


RULES = {
    "missing-requirement": _missing_requirements,
    "unused-extension": _unused_extension,
}
