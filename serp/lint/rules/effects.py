"""Rules: effects that come to nothing, or say twice that something is negative."""

from __future__ import annotations

from collections.abc import Iterator

from serp.lint.rules.exclusion import contradiction
from serp.lint.subject import LintSubject
from serp.model import ground as g
from serp.pddl import syntax as x
from serp.pddl.edits import Edit, Fix
from serp.pddl.source import DomainWarning, Place

_OPPOSITE = {x.Change.INCREASE: "decrease", x.Change.DECREASE: "increase"}
_NEUTRAL = {
    **dict.fromkeys((x.Change.INCREASE, x.Change.DECREASE), 0.0),
    **dict.fromkeys((x.Change.SCALE_UP, x.Change.SCALE_DOWN), 1.0),
}


def _no_change(subject: LintSubject) -> Iterator[DomainWarning]:
    yield from _already_so(subject)
    for what, effect in _changes(subject):
        if effect.change is x.Change.ASSIGN:
            same = isinstance(effect.value, x.FunctionTerm) and (
                effect.value.place.text.lower() == effect.function.place.text.lower()
            )
        else:
            value = effect.value
            same = isinstance(value, x.Number) and value.value == _NEUTRAL[effect.change]
        if same:
            yield DomainWarning(f"`{effect.place.text}` in {what} changes nothing", effect.place)


def _already_so(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find effects that make a predicate what it has to be where they happen."""
    refuted: set[Place] = set()
    found: dict[Place, str] = {}
    for name, schemas in subject.telling.items():
        for schema in schemas:
            for effect in schema.effects:
                if not isinstance(effect, g.SetBoolean) or effect.target < 0:
                    continue
                if effect.place in refuted:
                    continue
                holds: g.Test = g.Holds(effect.target, effect.place)
                otherwise = g.Not(holds, effect.place) if effect.value else holds
                tests = (*schema.preconditions, effect.condition)
                others = {e.target for e in schema.effects if e is not effect}
                if (
                    effect.target in others
                    or contradiction(tests, subject.theta)
                    or not contradiction((*tests, otherwise), subject.theta)
                ):
                    refuted.add(effect.place)
                found.setdefault(effect.place, f"{schema.kind.value} `{name}`")
    for place, what in found.items():
        if place not in refuted:
            text = f"`{place.text}` in {what} changes nothing: it is so wherever this happens"
            yield DomainWarning(text, place)


def _assigned_twice(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find functions that one list of effects sets to two numbers."""
    for schema in subject.domain.syntax.schemas:
        for effects in _lists(schema.effects):
            first: dict[str, x.ChangeFunction] = {}
            for effect in effects:
                if not isinstance(effect, x.ChangeFunction) or effect.change is not x.Change.ASSIGN:
                    continue
                known = first.setdefault(effect.function.place.text.lower(), effect)
                if known.value.place.text.lower() != effect.value.place.text.lower():
                    yield DomainWarning(
                        f"`{effect.place.text}` in {schema.kind.value} `{schema.name}` sets what "
                        f"`{known.place.text}` sets, and is carried out only where both are equal",
                        effect.place,
                    )


def _double_negative(subject: LintSubject) -> Iterator[DomainWarning]:
    for what, effect in _changes(subject):
        opposite = _OPPOSITE.get(effect.change)
        if opposite is None or not isinstance(effect.value, x.Number) or effect.value.value >= 0.0:
            continue
        place = effect.value.place
        yield DomainWarning(
            f"`{effect.place.text}` in {what} is `{opposite}`, because the number is negative",
            effect.place,
            advice=f"leave the minus out, or write `{opposite}`",
            fix=Fix((Edit(place.start, place.start + 1, ""),), sure=False),
        )


def _set_and_unset(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find what one list of effects makes false and true: in PDDL, true wins."""
    for schema in subject.domain.syntax.schemas:
        for effects in _lists(schema.effects):
            made = {_key(e.atom) for e in effects if isinstance(e, x.SetPredicate) and e.value}
            for effect in effects:
                if (
                    isinstance(effect, x.SetPredicate)
                    and not effect.value
                    and _key(effect.atom) in made
                ):
                    yield DomainWarning(
                        f"`{effect.place.text}` in {schema.kind.value} `{schema.name}` comes to "
                        f"nothing: `{effect.atom.place.text}` is made true at the same time",
                        effect.place,
                    )


def _repeated(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find what one list of effects makes true, or sets, a second time in the same words."""
    for schema in subject.domain.syntax.schemas:
        for effects in _lists(schema.effects):
            told: set[str] = set()
            for effect in effects:
                text = effect.place.text.lower()
                adds = isinstance(effect, x.ChangeFunction) and effect.change.group != "assign"
                if text in told and not adds:  # two increases count twice
                    yield DomainWarning(
                        f"`{effect.place.text}` in {schema.kind.value} `{schema.name}` stands "
                        "there twice",
                        effect.place,
                    )
                told.add(text)


def _key(atom: x.Atom) -> tuple[str, ...]:
    return (atom.name, *(argument.name for argument in atom.arguments))


def _lists(effects: tuple[x.Effect, ...]) -> Iterator[tuple[x.Effect, ...]]:
    """Yield effects that happen together, and those under each `when` and `forall`."""
    yield effects
    for effect in effects:
        if isinstance(effect, x.When | x.ForallEffect):
            yield from _lists(effect.effects)


def _changes(subject: LintSubject) -> Iterator[tuple[str, x.ChangeFunction]]:
    for schema in subject.domain.syntax.schemas:
        for effect in x.nested_effects(schema.effects):
            if isinstance(effect, x.ChangeFunction):
                yield f"{schema.kind.value} `{schema.name}`", effect


RULES = {
    "no-change": _no_change,
    "assigned-twice": _assigned_twice,
    "double-negative": _double_negative,
    "set-and-unset": _set_and_unset,
    "repeated-effect": _repeated,
}
