"""Finding the permutations of objects that map an instantiated domain onto itself.

The model is a set of items (actions, processes, events, goal, metric, static values) over fluents
over objects. Items that mean the same get the same number, whatever the order of conjuncts, sums
and effects; a permutation is a symmetry when it maps items onto items. Candidates come from colour
refinement with backtracking, as in tools for graph automorphisms (McKay 1981).

What is found is exact, up to the order in which floats are added.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from serp.domain import ground as g
from serp.domain.source import Place
from serp.domain.symmetry import ModelSymmetry, cycles, permuted_columns
from serp.domain.syntax import Change

MAX_WORK = 1_000_000
"""Expressions looked at before the search gives up; about a second."""

Seen = Callable[[int], int]
"""What a fluent, by its column, is taken for."""

_ADDITIVE = (Change.INCREASE, Change.DECREASE)


class Asymmetry(Exception):
    """A permutation is no symmetry.

    Attributes:
        what: The reason, in words.
        place: Where in the files, if anywhere.
    """

    def __init__(self, what: str, place: Place | None = None) -> None:
        super().__init__(what)
        self.what = what
        self.place = place


@dataclass(frozen=True)
class Symmetries:
    """What the search found.

    Attributes:
        generators: Symmetries that generate all that were found, none of them trivial.
        complete: False where the search gave up: there may be more.
    """

    generators: tuple[ModelSymmetry, ...]
    complete: bool

    def told(self) -> list[str]:
        """Return the generators in words; of objects that are all alike in one."""
        pairs = [s.objects for s in self.generators if len(s.objects) == 2]
        alike = _Orbits(name for pair in pairs for name in pair)
        for one, other in pairs:
            alike.join(one, other)
        classes: dict[str, list[str]] = {}
        for name in alike.parent:
            classes.setdefault(alike.of(name), []).append(name)
        told = [
            " <-> ".join(c) if len(c) == 2 else f"{', '.join(c)} in any order"
            for c in classes.values()
        ]
        return told + [cycles(s.objects) for s in self.generators if len(s.objects) != 2]


def find_symmetries(ground: g.GroundModel, max_work: int = MAX_WORK) -> Symmetries:
    """Find the permutations of objects that map a model onto itself.

    Deterministic. Initial values are left out of account: where a task begins does not change what
    its actions do.

    Args:
        ground: The model.
        max_work: Expressions looked at at most.
    """
    return _Search(ground, max_work).run()


def symmetry_of(ground: g.GroundModel, objects: Mapping[str, str]) -> ModelSymmetry:
    """Return what a permutation of objects makes of states and actions.

    Raises:
        Asymmetry: It does not map the model onto itself.
    """
    return _Items(ground, _Work(None)).apply(objects)


class _GaveUp(Exception):
    pass


class _Work:
    """Counts what was looked at."""

    def __init__(self, most: int | None) -> None:
        self.left = most

    def count(self, amount: int = 1) -> None:
        if self.left is not None:
            self.left -= amount
            if self.left < 0:
                raise _GaveUp


class _Numbering:
    """Numbers for expressions: equal where they mean the same over numbered fluents."""

    def __init__(self, ground: g.GroundModel, work: _Work) -> None:
        self.theta = [p.value for p in ground.parameters]
        self.known: dict[Hashable, int] = {}
        self.work = work

    def number(self, *key: Hashable) -> int:
        self.work.count()
        return self.known.setdefault(key, len(self.known))

    def schema(self, schema: g.GroundSchema, seen: Seen) -> int:
        tests = sorted({self.test(test, seen) for test in schema.preconditions})
        effects = sorted(self._effect(effect, seen) for effect in schema.effects)
        return self.number(schema.kind, tuple(tests), tuple(effects))

    def _effect(self, effect: g.GroundEffect, seen: Seen) -> int:
        target = effect.target if effect.target < 0 else seen(effect.target)
        condition = self.test(effect.condition, seen)
        if isinstance(effect, g.SetBoolean):
            return self.number("set", target, effect.value, condition)
        return self.number(effect.change, target, self.value(effect.value, seen), condition)

    def test(self, test: g.Test, seen: Seen) -> int:
        match test:
            case g.Constant(value):
                return self.number("constant", value)
            case g.Holds(fluent):
                return self.number("holds", fluent if fluent < 0 else seen(fluent))
            case g.Not(operand):
                return self.number("not", self.test(operand, seen))
            case g.Compare(operator, left, right):
                sides = [self.value(left, seen), self.value(right, seen)]
                if operator in (">", ">="):
                    operator = operator.replace(">", "<")
                    sides.reverse()
                elif operator == "=":
                    sides.sort()
                return self.number(operator, *sides)
            case g.All(operands) | g.AnyOf(operands):
                joined = sorted({self.test(operand, seen) for operand in operands})
                return self.number(type(test).__name__, tuple(joined))

    def value(self, value: g.Value, seen: Seen) -> int:
        match value:
            case g.Read(fluent):
                return self.number("read", seen(fluent))
            case g.Literal(parameter):
                return self.number("literal", self.theta[parameter])
            case g.Elapsed():
                return self.number("elapsed")
            case g.Negation(operand):
                return self.number("negative", self.value(operand, seen))
            case g.Operation(operator, left, right):
                if operator in "+*":
                    terms = sorted(self.value(v, seen) for v in _terms(value, operator))
                    return self.number(operator, tuple(terms))
                return self.number(operator, self.value(left, seen), self.value(right, seen))


def _terms(value: g.Value, operator: str) -> Iterator[g.Value]:
    """Yield the operands of a sum or product of several."""
    if isinstance(value, g.Operation) and value.operator == operator:
        yield from _terms(value.left, operator)
        yield from _terms(value.right, operator)
    else:
        yield value


class _Items:
    """The items of a model, ready for permutations to be applied."""

    def __init__(self, ground: g.GroundModel, work: _Work) -> None:
        self.ground = ground
        self.work = work
        self.numbering = _Numbering(ground, work)
        self.schemas = (*ground.actions, *ground.processes, *ground.events)
        self.static = {tuple(name.split()): value for name, value in ground.static.items()}
        self.same: Seen = int
        self.numbers = [self.numbering.schema(s, self.same) for s in self.schemas]
        self.named = {(s.kind, s.schema, s.arguments): k for k, s in enumerate(self.schemas)}
        self.mentions = [self._mentions(schema) for schema in self.schemas]
        self.plain: dict[int, list[int]] = {}
        """Number → schemas without parameters that have it: they may take each other's place."""
        for k, schema in enumerate(self.schemas):
            if not schema.arguments:
                self.plain.setdefault(self.numbers[k], []).append(k)

    def _mentions(self, schema: g.GroundSchema) -> frozenset[str]:
        touched = {f for f in (*g.reads(schema), *g.writes(schema)) if f >= 0}
        fluents = self.ground.fluents
        return frozenset(schema.arguments).union(*(fluents[f].arguments for f in touched))

    @property
    def objects(self) -> list[str]:
        """Every object that fluents, items or static values name, in the order of appearance."""
        found: dict[str, None] = {}
        for fluent in self.ground.fluents:
            found.update(dict.fromkeys(fluent.arguments))
        for schema in self.schemas:
            found.update(dict.fromkeys(schema.arguments))
        for _, *arguments in self.static:
            found.update(dict.fromkeys(arguments))
        return list(found)

    def apply(self, objects: Mapping[str, str]) -> ModelSymmetry:
        """Return the symmetry that a permutation of objects is.

        Raises:
            Asymmetry: It is none.
        """
        fluents = self.ground.fluents
        self.work.count(len(fluents) + len(self.schemas))
        columns = permuted_columns(fluents, objects)
        if isinstance(columns, g.Fluent):
            raise Asymmetry(f"fluent `{columns.name}` has no mirror image")
        places = [0] * len(fluents)
        for column, source in enumerate(columns):
            places[source] = column
        for key, value in self.static.items():
            image = (key[0], *(objects.get(o, o) for o in key[1:]))
            if self.static.get(image) != value:
                raise Asymmetry(f"({' '.join(key)}) is {value:g}, ({' '.join(image)}) is not")
        images = self._images(objects, places.__getitem__)
        self._same_order_of_events(images)
        self._same_goal_and_metric(places.__getitem__)
        return ModelSymmetry(
            objects={name: image for name, image in objects.items() if name != image},
            columns=columns,
            signs=(1.0,) * len(columns),
            actions=tuple(images[: len(self.ground.actions)]),
        )

    def _images(self, objects: Mapping[str, str], places: Seen) -> list[int]:
        """Return the image of every schema."""
        moved = {name for name, image in objects.items() if name != image}
        images = list(range(len(self.schemas)))
        for k, schema in enumerate(self.schemas):
            if not schema.arguments or moved.isdisjoint(self.mentions[k]):
                continue
            arguments = tuple(objects.get(o, o) for o in schema.arguments)
            image = self.named.get((schema.kind, schema.schema, arguments))
            number = self.numbering.schema(schema, places)
            if image is None or self.numbers[image] != number:
                mirror = " ".join((schema.schema, *arguments))
                raise Asymmetry(
                    f"{schema.kind.value} `{schema.name}` and `{mirror}` are no mirror images",
                    schema.place,
                )
            images[k] = image
        for members in self.plain.values():
            first = self.schemas[members[0]]
            if moved.isdisjoint(self.mentions[members[0]]):
                continue
            others = self.plain.get(self.numbering.schema(first, places), [])
            if len(others) != len(members):
                raise Asymmetry(
                    f"{first.kind.value} `{first.name}` has no mirror image", first.place
                )
            for k, image in zip(members, others, strict=True):
                images[k] = image
        return images

    def _same_order_of_events(self, images: Sequence[int]) -> None:
        """Events fire in file order: where the mirror image fires them in another, it matters not.

        Two neighbours may change places when neither reads what the other writes, and what both
        write comes to the same in either order.
        """
        start = len(self.schemas) - len(self.ground.events)
        order = images[start:]
        if all(a < b for a, b in pairwise(order)):
            return
        for i, later in enumerate(order):
            self.work.count(len(order) - i)
            for j in range(i + 1, len(order)):
                if order[j] < later and self.numbers[order[j]] != self.numbers[later]:
                    one, other = self.schemas[start + i], self.schemas[start + j]
                    if not _independent(one, other):
                        raise Asymmetry(
                            f"event `{one.name}` fires before `{other.name}`, their mirror images "
                            "the other way round, and the order matters",
                            other.place,
                        )

    def _same_goal_and_metric(self, places: Seen) -> None:
        goal, metric, number = self.ground.goal, self.ground.metric, self.numbering
        if goal is not None and number.test(goal, places) != number.test(goal, self.same):
            raise Asymmetry("the goal is not its own mirror image")
        if metric is not None and (
            number.value(metric.value, places) != number.value(metric.value, self.same)
        ):
            raise Asymmetry("the metric is not its own mirror image", metric.place)


def _independent(one: g.GroundSchema, other: g.GroundSchema) -> bool:
    """Whether two events come to the same in either order."""
    if g.writes(one) & g.reads(other) or g.writes(other) & g.reads(one):
        return False
    ways: dict[int, set[Hashable]] = {}
    for effect in (*one.effects, *other.effects):
        ways.setdefault(effect.target, set()).add(_way(effect))
    shared = g.writes(one) & g.writes(other)
    return all(len(ways[t]) == 1 and ways[t] != {Change.ASSIGN} for t in shared)


def _way(effect: g.GroundEffect) -> Hashable:
    if isinstance(effect, g.SetBoolean):
        return effect.value
    if effect.change in _ADDITIVE:
        return "add"
    return effect.change if effect.change is Change.ASSIGN else "scale"


class _Search:
    """Colour refinement with backtracking over the objects."""

    def __init__(self, ground: g.GroundModel, max_work: int) -> None:
        self.ground = ground
        self.work = _Work(max_work)

    def run(self) -> Symmetries:
        found: list[ModelSymmetry] = []
        try:
            self.items = _Items(self.ground, self.work)
            self.objects = self.items.objects
            for symmetry in self._generators():
                if not symmetry.trivial:
                    found.append(symmetry)
        except _GaveUp:
            return Symmetries(tuple(found), complete=False)
        return Symmetries(tuple(found), complete=True)

    def _generators(self) -> Iterator[ModelSymmetry]:
        """Yield symmetries that generate all others."""
        base = self._refined(dict.fromkeys(self.objects, 0))
        alike: dict[str, str] = {}
        """Object → the first that it may simply be exchanged with (an equivalence)."""
        for position, name in enumerate(self.objects):
            alike[name] = name
            for first in self.objects[:position]:
                if alike[first] != first or base[first] != base[name]:
                    continue
                symmetry = self._try({first: name, name: first})
                if symmetry is not None:
                    alike[name] = first
                    yield symmetry
                    break
        # A chain of stabilisers: for every object, where else it can go with all before it fixed.
        known: list[Mapping[str, str]] = []
        for position, name in enumerate(self.objects):
            fixed = self.objects[:position]
            orbit = _Orbits(self.objects)
            first_alike: dict[str, str] = {}
            for other in self.objects[position:]:
                orbit.join(other, first_alike.setdefault(alike[other], other))
            for mapping in known:
                if all(o not in mapping for o in fixed):
                    for source, image in mapping.items():
                        orbit.join(source, image)
            for other in self.objects[position + 1 :]:
                if base[other] != base[name] or orbit.of(other) == orbit.of(name):
                    continue
                symmetry = self._extend(base, fixed, name, other)
                if symmetry is not None:
                    known.append(symmetry.objects)
                    for source, image in symmetry.objects.items():
                        orbit.join(source, image)
                    yield symmetry

    def _try(self, mapping: Mapping[str, str]) -> ModelSymmetry | None:
        try:
            return self.items.apply(mapping)
        except Asymmetry:
            return None

    def _extend(
        self, base: Mapping[str, int], fixed: Iterable[str], name: str, image: str
    ) -> ModelSymmetry | None:
        """Return a symmetry that keeps some objects and moves one to another, or None."""
        own = {o: self.items.numbering.number("fixed", k, base[o]) for k, o in enumerate(fixed)}
        left, right = {**base, **own}, {**base, **own}
        return self._match(left, right, name, image)

    def _match(
        self, left: Mapping[str, int], right: Mapping[str, int], name: str, image: str
    ) -> ModelSymmetry | None:
        chosen = self.items.numbering.number("chosen", left[name])
        left = self._refined({**left, name: chosen})
        right = self._refined({**right, image: chosen})
        if sorted(left.values()) != sorted(right.values()):
            return None
        cells: dict[int, list[str]] = {}
        for o, colour in right.items():
            cells.setdefault(colour, []).append(o)
        for o, colour in left.items():
            if len(cells[colour]) > 1:
                # Stay first: what need not move stays where it is.
                for candidate in sorted(cells[colour], key=lambda c: (c != o, c)):
                    symmetry = self._match(left, right, o, candidate)
                    if symmetry is not None:
                        return symmetry
                return None
        return self._try({o: cells[colour][0] for o, colour in left.items()})

    def _refined(self, colours: dict[str, int]) -> dict[str, int]:
        """Split colours until objects of one colour play the same part among the colours."""
        while True:
            finer = self._split(colours)
            if len(set(finer.values())) == len(set(colours.values())):
                return finer
            colours = finer

    def _split(self, colours: Mapping[str, int]) -> dict[str, int]:
        items, numbering = self.items, self.items.numbering
        number, fluents = numbering.number, self.ground.fluents
        seen = {name: self._seen(colours, name) for name in colours}
        parts: dict[str, list[int]] = {name: [] for name in colours}
        for schema, mentions in zip(items.schemas, items.mentions, strict=True):
            what = schema.schema if schema.arguments else ""
            for name in mentions:
                arguments = _colours_of(schema.arguments, colours, name)
                inner = numbering.schema(schema, seen[name])
                parts[name].append(number("schema", what, arguments, inner))
        for key, value in items.static.items():
            for name in set(key[1:]):
                arguments = _colours_of(key[1:], colours, name)
                parts[name].append(number("static", key[0], arguments, value))
        for fluent in fluents:
            for name in set(fluent.arguments):
                parts[name].append(seen[name](fluent.index))
        goal, metric = self.ground.goal, self.ground.metric
        if goal is not None:
            for name in _objects_of(fluents, goal):
                parts[name].append(number("goal", numbering.test(goal, seen[name])))
        if metric is not None:
            for name in _objects_of(fluents, metric.value):
                parts[name].append(number("metric", numbering.value(metric.value, seen[name])))
        return {name: number("colour", colours[name], tuple(sorted(parts[name]))) for name in parts}

    def _seen(self, colours: Mapping[str, int], name: str) -> Seen:
        """Return what fluents are taken for by an object that sees but the colour of others."""
        known: dict[int, int] = {}

        def seen(column: int) -> int:
            if column not in known:
                fluent = self.ground.fluents[column]
                arguments = _colours_of(fluent.arguments, colours, name)
                known[column] = self.items.numbering.number("fluent", fluent.symbol, arguments)
            return known[column]

        return seen


def _colours_of(
    arguments: tuple[str, ...], colours: Mapping[str, int], name: str
) -> tuple[int, ...]:
    return tuple(-1 if o == name else colours[o] for o in arguments)


def _objects_of(fluents: Sequence[g.Fluent], node: g.Test | g.Value) -> set[str]:
    return {o for f in g.fluents_of(node) if f >= 0 for o in fluents[f].arguments}


class _Orbits:
    """Classes of objects that can take each other's place."""

    def __init__(self, objects: Iterable[str]) -> None:
        self.parent = {name: name for name in objects}

    def of(self, name: str) -> str:
        while self.parent[name] != name:
            name = self.parent[name]
        return name

    def join(self, one: str, other: str) -> None:
        self.parent[self.of(one)] = self.of(other)
