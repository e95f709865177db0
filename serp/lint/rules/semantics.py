"""Rules: conditions that never hold, and actions that are never safe."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from serp.lint.rules.exclusion import Pair, contradiction
from serp.lint.subject import LintSubject
from serp.model import ground as g
from serp.model.ground import TERMINAL_TARGET, UNSAFE_TARGET
from serp.pddl.source import DomainWarning, Place
from serp.pddl.syntax import Kind

_CANNOT = {
    Kind.ACTION: "can never be applied",
    Kind.PROCESS: "can never run",
    Kind.EVENT: "can never fire",
}


def _contradictory(subject: LintSubject) -> Iterator[DomainWarning]:
    for name, schemas in subject.telling.items():
        if pair := _contradiction_in_all(subject, schemas):
            kind, place = schemas[0].kind, schemas[0].place.opening
            yield DomainWarning(
                f"{kind.value} `{name}` {_CANNOT[kind]}: {_exclude(pair)}",
                _second(pair, place),
                advice=_or_instead(pair),
            )


def _not_reached(subject: LintSubject) -> Iterator[DomainWarning]:
    reached = {schema.schema for schema in subject.domain.model.ground.schemas}
    for name, schemas in subject.instances.items():
        telling = subject.telling.get(name, [])
        if name not in reached and not _contradiction_in_all(subject, telling):
            kind, place = schemas[0].kind, schemas[0].place.opening
            yield DomainWarning(
                f"{kind.value} `{name}` {_CANNOT[kind]} from the problem's :init on", place
            )


def _always_unsafe(subject: LintSubject) -> Iterator[DomainWarning]:
    for what, schemas in _possible(subject):
        kind, place = schemas[0].kind, schemas[0].place.opening
        if kind is Kind.ACTION and all(_unsafe(schema, subject.theta) for schema in schemas):
            yield DomainWarning(
                f"{what} is unsafe wherever it can be applied: it is executed only where every "
                "other action is unsafe too",
                place,
            )
        if kind is Kind.EVENT and any(
            _makes_all_unsafe(schema, subject.theta) for schema in schemas
        ):
            yield DomainWarning(f"{what} makes every action unsafe: it always fires", place)


def _possible(subject: LintSubject) -> Iterator[tuple[str, list[g.GroundSchema]]]:
    """Yield kind with name, and instances, of the schemas that can happen."""
    reached = {schema.schema for schema in subject.domain.model.ground.schemas}
    for name, schemas in subject.telling.items():
        if name in reached and not _contradiction_in_all(subject, schemas):
            yield f"{schemas[0].kind.value} `{name}`", schemas


def _contradiction_in_all(subject: LintSubject, schemas: list[g.GroundSchema]) -> Pair | None:
    """Return tests of the first instance that exclude each other if there are some in all."""
    return _in_all(contradiction(schema.preconditions, subject.theta) for schema in schemas)


def _in_all(pairs: Iterable[Pair | None]) -> Pair | None:
    """Return the first pair if there is one everywhere."""
    first: Pair | None = None
    for pair in pairs:
        if pair is None:
            return None
        first = first or pair
    return first


def _unsafe(schema: g.GroundSchema, theta: list[float]) -> bool:
    for effect in schema.effects:
        if isinstance(effect, g.SetBoolean) and effect.target == UNSAFE_TARGET and effect.value:
            # The condition follows from the precondition where its opposite contradicts it.
            opposite = g.Not(effect.condition, effect.place)
            if contradiction((*schema.preconditions, opposite), theta):
                return True
    return False


def _makes_all_unsafe(event: g.GroundSchema, theta: list[float]) -> bool:
    """Say whether nothing keeps an event from firing, and from damage where it fires."""
    fires = all(
        contradiction((g.Not(condition, event.place),), theta) for condition in event.preconditions
    )
    return fires and _unsafe(event, theta)


def _dead_effects(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find effects under a `when` that can hold in no instance."""
    for what, schemas in _possible(subject):
        yield from _never_in_any(what, schemas, subject.theta)


def _flags_never_set(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find events that wait for a flag which is only ever set where they cannot fire."""
    ground, told = subject.anywhere, set[str]()
    moved = {target for event in ground.events for target in g.writes(event)}
    for event in ground.events:
        for read in event.preconditions:
            if not isinstance(read, g.Holds) or read.fluent not in (UNSAFE_TARGET, TERMINAL_TARGET):
                continue
            pairs = _excluded_setters(subject, event, read)
            # What other events change may differ by the time this one reads the flag.
            still = all(moved.isdisjoint(f) for p in pairs for t in p for f in [{*g.fluents_of(t)}])
            if pairs and still and event.schema not in told:
                told.add(event.schema)
                yield DomainWarning(
                    f"event `{event.schema}` can never fire: where `{read.place.text}` is made "
                    f"true, {_exclude(pairs[0])}",
                    read.place,
                )


def _excluded_setters(subject: LintSubject, event: g.GroundSchema, read: g.Holds) -> list[Pair]:
    """Return what keeps an event from firing beside each setter of a flag; [] if one does not."""
    others = [test for test in event.preconditions if test is not read]
    pairs: list[Pair] = []
    for schema in subject.anywhere.schemas:
        for effect in schema.effects:
            if effect.target != read.fluent or schema.name == event.name:
                continue
            tests = (*schema.preconditions, effect.condition, *others)
            pair = contradiction(tests, subject.theta) if schema.kind is Kind.EVENT else None
            if pair is None:  # an action sets it: what it finds may change within the step
                return []
            pairs.append(pair)
    return pairs


def _never_in_any(
    what: str, schemas: list[g.GroundSchema], theta: list[float]
) -> Iterator[DomainWarning]:
    possible: set[Place] = set()
    never: dict[Place, Pair] = {}
    for schema in schemas:
        for effect in schema.effects:
            if effect.place in possible or isinstance(effect.condition, g.Constant):
                continue
            pair = contradiction((*schema.preconditions, effect.condition), theta)
            if pair is None:
                possible.add(effect.place)
            else:
                never.setdefault(effect.place, pair)
    for place, pair in never.items():
        if place not in possible:
            yield DomainWarning(
                f"`{place.text}` in {what} can never happen: {_exclude(pair)}",
                _second(pair, place),
                advice=_or_instead(pair),
            )


def _exclude(pair: Pair) -> str:
    first, second = (_shown(test) for test in _in_order(pair))
    return f"{first} never holds" if first == second else f"{first} and {second} exclude each other"


def _or_instead(pair: Pair) -> str:
    bounds = all(isinstance(test, g.Compare) for test in pair) and pair[0] != pair[1]
    return "write `or` if one of the two is enough" if bounds else ""


def _shown(test: g.Test) -> str:
    return "a condition" if isinstance(test, g.Constant) else f"`{test.place.text}`"


def _second(pair: Pair, otherwise: Place) -> Place:
    second = _in_order(pair)[1]
    return otherwise if isinstance(second, g.Constant) else second.place


def _in_order(pair: Pair) -> Pair:
    """Return two tests as they stand in the file."""
    first, second = pair
    if isinstance(first, g.Constant) or isinstance(second, g.Constant):
        return pair
    same_file = first.place.source is second.place.source
    return (second, first) if same_file and second.place.start < first.place.start else pair


RULES = {
    "contradictory-condition": _contradictory,
    "not-reached": _not_reached,
    "always-unsafe": _always_unsafe,
    "dead-effect": _dead_effects,
    "flag-never-set": _flags_never_set,
}
