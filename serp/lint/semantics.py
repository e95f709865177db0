"""What a domain says that can hardly be meant: conditions that never hold, actions never safe."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator

from serp.lint.exclusion import Pair, contradiction
from serp.model import ground as g
from serp.model.loading import Domain
from serp.pddl.source import DomainError, DomainWarning, Place
from serp.pddl.syntax import Kind

_CANNOT = {
    Kind.ACTION: "can never be applied",
    Kind.PROCESS: "can never run",
    Kind.EVENT: "can never fire",
}


def semantic_warnings(domain: Domain, wide: g.GroundModel) -> Iterator[DomainWarning]:
    """Yield what can never happen in any instance, and which actions are unsafe in all of them.

    Args:
        domain: A domain that was loaded, hence free of errors.
        wide: The same for any states (`anywhere`).
    """
    reached = {s.schema for s in domain.model.ground.schemas}
    theta = [parameter.value for parameter in wide.parameters]
    instances: dict[str, list[g.GroundSchema]] = {}
    for instance in wide.schemas:
        instances.setdefault(instance.schema, []).append(instance)
    excluded = functools.partial(contradiction, theta=theta)
    for name, schemas in instances.items():
        kind, place = schemas[0].kind, schemas[0].place
        what = f"{kind.value} `{name}`"
        if pair := _in_all(excluded(schema.preconditions) for schema in schemas):
            yield DomainWarning(f"{what} {_CANNOT[kind]}: {_exclude(pair)}", _second(pair, place))
            continue
        if name not in reached:
            yield DomainWarning(f"{what} {_CANNOT[kind]} from the problem's :init on", place)
            continue
        if kind is Kind.ACTION and all(_always_unsafe(schema, theta) for schema in schemas):
            yield DomainWarning(
                f"{what} is unsafe wherever it can be applied: it is executed only where every "
                "other action is unsafe too",
                place,
            )
        if kind is Kind.EVENT and any(_makes_all_unsafe(schema, theta) for schema in schemas):
            yield DomainWarning(f"{what} makes every action unsafe: it always fires", place)
        yield from _effects_without_use(what, schemas, theta)


def anywhere(domain: Domain) -> g.GroundModel:
    """Return the domain for states that need not be reached from the problem's `:init`.

    Where that is too large, or needs numbers that nobody stated, it is what can be reached.
    """
    try:
        return domain.observed().model.ground
    except DomainError:
        return domain.model.ground


def _in_all(pairs: Iterable[Pair | None]) -> Pair | None:
    """Return the first pair if there is one everywhere."""
    first: Pair | None = None
    for pair in pairs:
        if pair is None:
            return None
        first = first or pair
    return first


def _always_unsafe(schema: g.GroundSchema, theta: list[float]) -> bool:
    for effect in schema.effects:
        if isinstance(effect, g.SetBoolean) and effect.target == g.UNSAFE_TARGET and effect.value:
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
    return fires and _always_unsafe(event, theta)


def _effects_without_use(
    what: str, schemas: list[g.GroundSchema], theta: list[float]
) -> Iterator[DomainWarning]:
    """Find effects under a `when` that can hold in no instance."""
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
            )


def _exclude(pair: Pair) -> str:
    first, second = (_shown(test) for test in pair)
    return f"{first} never holds" if first == second else f"{first} and {second} exclude each other"


def _shown(test: g.Test) -> str:
    return "a condition" if isinstance(test, g.Constant) else f"`{test.place.text}`"


def _second(pair: Pair, otherwise: Place) -> Place:
    return otherwise if isinstance(pair[1], g.Constant) else pair[1].place
