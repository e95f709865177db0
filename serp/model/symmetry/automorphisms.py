"""Finding the permutations of objects that map a ground model onto itself.

The model is a set of items (actions, processes, events, goal, metric, static values) over fluents
over objects. Items that mean the same get the same number, see `serp.model.symmetry.numbering`; a
permutation is a symmetry when it maps items onto items. Candidates come from colour refinement
with backtracking, as in tools for graph automorphisms (McKay, "Practical graph isomorphism", 1981).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from serp.model import ground as g
from serp.model.symmetry.model_symmetry import ModelSymmetry, cycles
from serp.model.symmetry.numbering import GaveUp, Seen
from serp.model.symmetry.permutation import Asymmetry, Items

MAX_WORK = 1_000_000
"""Expressions visited before the search gives up; about a second."""


@dataclass(frozen=True)
class Symmetries:
    """The result of the search.

    Attributes:
        generators: Symmetries that generate all that were found; none is the identity.
        complete: False where the search was cut short: there may be more.
    """

    generators: tuple[ModelSymmetry, ...]
    complete: bool

    def described(self) -> list[str]:
        """Return the generators in words; interchangeable objects are listed together."""
        pairs = [s.objects for s in self.generators if len(s.objects) == 2]
        alike = _Orbits(name for pair in pairs for name in pair)
        for one, other in pairs:
            alike.join(one, other)
        classes: dict[str, list[str]] = {}
        for name in alike.parent:
            classes.setdefault(alike.of(name), []).append(name)
        described = [
            " <-> ".join(c) if len(c) == 2 else f"{', '.join(c)} in any order"
            for c in classes.values()
        ]
        return described + [cycles(s.objects) for s in self.generators if len(s.objects) != 2]


def find_symmetries(ground: g.GroundModel, max_work: int = MAX_WORK) -> Symmetries:
    """Find the permutations of objects that map a model onto itself.

    Deterministic. Initial values do not count, since they do not change the effects of actions.

    Args:
        ground: The model.
        max_work: Most expressions that are visited.
    """
    return _Search(ground, max_work).run()


class _Search:
    """Colour refinement with backtracking over the objects."""

    def __init__(self, ground: g.GroundModel, max_work: int) -> None:
        self.ground = ground
        self.max_work = max_work

    def run(self) -> Symmetries:
        found: list[ModelSymmetry] = []
        try:
            self.items = Items(self.ground, self.max_work)
            self.objects = self.items.objects
            for symmetry in self._generators():
                if not symmetry.trivial:
                    found.append(symmetry)
        except GaveUp:
            return Symmetries(tuple(found), complete=False)
        return Symmetries(tuple(found), complete=True)

    def _generators(self) -> Iterator[ModelSymmetry]:
        """Yield symmetries that generate all others."""
        base = self._refined(dict.fromkeys(self.objects, 0))
        alike: dict[str, str] = {}
        """Object → the first one that it can be exchanged with (an equivalence)."""
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
        # A chain of stabilisers: the images of each object while all objects before it are fixed.
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
                # Try the identity first, so that objects move only where they have to.
                for candidate in sorted(cells[colour], key=lambda c: (c != o, c)):
                    symmetry = self._match(left, right, o, candidate)
                    if symmetry is not None:
                        return symmetry
                return None
        return self._try({o: cells[colour][0] for o, colour in left.items()})

    def _refined(self, colours: dict[str, int]) -> dict[str, int]:
        """Split colours until objects of one colour have the same role among the colours."""
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
        """Return the numbers of fluents, given an object and only the colours of the others."""
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
    """Classes of objects that can be exchanged."""

    def __init__(self, objects: Iterable[str]) -> None:
        self.parent = {name: name for name in objects}

    def of(self, name: str) -> str:
        while self.parent[name] != name:
            name = self.parent[name]
        return name

    def join(self, one: str, other: str) -> None:
        self.parent[self.of(one)] = self.of(other)
