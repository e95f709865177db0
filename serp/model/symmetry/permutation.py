"""Applying a permutation of objects to a model: a symmetry maps the model onto itself."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from itertools import pairwise

from serp.model import ground as g
from serp.model.symmetry.canonical import Canonical
from serp.model.symmetry.model_symmetry import ModelSymmetry, permuted_columns
from serp.pddl.source import Place


class Asymmetry(Exception):
    """A permutation is not a symmetry."""

    def __init__(self, what: str, place: Place | None = None) -> None:
        super().__init__(f"{place}: {what}" if place else what)


class Permutations:
    """Permutations of the objects of one model.

    The model is a set of items (actions, processes, events, goal, metric, static values) over
    fluents over objects. A permutation is a symmetry when it maps items onto items that mean the
    same. Initial values do not count, since they do not change the effects of actions.
    """

    def __init__(self, ground: g.GroundModel) -> None:
        self.ground = ground
        self.theta = [p.value for p in ground.parameters]
        self.schemas = ground.schemas
        self.static = {tuple(name.split()): value for name, value in ground.static.items()}
        self.same = Canonical(self.theta, int)
        self.forms = [self.same.schema(schema) for schema in self.schemas]
        self.named = {(s.kind, s.schema, s.arguments): k for k, s in enumerate(self.schemas)}
        self.mentions = [self._mentions(schema) for schema in self.schemas]
        self.plain: dict[Hashable, list[int]] = {}
        """Form → schemas without parameters that have it: they are interchangeable."""
        for k, schema in enumerate(self.schemas):
            if not schema.arguments:
                self.plain.setdefault(self.forms[k], []).append(k)

    def _mentions(self, schema: g.GroundSchema) -> frozenset[str]:
        touched = {f for f in (*g.reads(schema), *g.writes(schema)) if f >= 0}
        fluents = self.ground.fluents
        return frozenset(schema.arguments).union(*(fluents[f].arguments for f in touched))

    def symmetry(self, objects: Mapping[str, str]) -> ModelSymmetry:
        """Return the symmetry that a permutation defines; objects that are left out stay."""
        columns = permuted_columns(self.ground.fluents, objects)
        if isinstance(columns, g.Fluent):
            raise Asymmetry(f"fluent `{columns.name}` has no mirror image")
        places = [0] * len(columns)
        for column, source in enumerate(columns):
            places[source] = column
        for key, value in self.static.items():
            image = (key[0], *(objects.get(o, o) for o in key[1:]))
            if self.static.get(image) != value:
                raise Asymmetry(f"({' '.join(key)}) is {value:g}, ({' '.join(image)}) is not")
        mirrored = Canonical(self.theta, places.__getitem__)
        images = self._images(objects, mirrored.schema)
        self._same_order_of_events(images)
        goal, metric = self.ground.goal, self.ground.metric
        if goal is not None and mirrored.test(goal) != self.same.test(goal):
            raise Asymmetry("the goal is not its own mirror image")
        if metric is not None and mirrored.value(metric.value) != self.same.value(metric.value):
            raise Asymmetry("the metric is not its own mirror image", metric.place)
        return ModelSymmetry(
            objects={name: image for name, image in objects.items() if name != image},
            columns=columns,
            signs=(1.0,) * len(columns),
            actions=tuple(images[: len(self.ground.actions)]),
        )

    def _images(
        self, objects: Mapping[str, str], mirrored: Callable[[g.GroundSchema], Hashable]
    ) -> list[int]:
        """Return the image of every schema."""
        moved = {name for name, image in objects.items() if name != image}
        images = list(range(len(self.schemas)))
        for k, schema in enumerate(self.schemas):
            if not schema.arguments or moved.isdisjoint(self.mentions[k]):
                continue
            arguments = tuple(objects.get(o, o) for o in schema.arguments)
            image = self.named.get((schema.kind, schema.schema, arguments))
            if image is None or self.forms[image] != mirrored(schema):
                mirror = " ".join((schema.schema, *arguments))
                raise Asymmetry(
                    f"{schema.kind.value} `{schema.name}` and `{mirror}` are not mirror images",
                    schema.place,
                )
            images[k] = image
        for members in self.plain.values():
            first = self.schemas[members[0]]
            if moved.isdisjoint(self.mentions[members[0]]):
                continue
            others = self.plain.get(mirrored(first), [])
            if len(others) != len(members):
                raise Asymmetry(
                    f"{first.kind.value} `{first.name}` has no mirror image", first.place
                )
            for k, image in zip(members, others, strict=True):
                images[k] = image
        return images

    def _same_order_of_events(self, images: Sequence[int]) -> None:
        """Check that no result depends on the order in which the mirror images of events fire.

        Events fire in file order. Two may be exchanged where neither reads what the other writes
        and their common writes commute.
        """
        start = len(self.schemas) - len(self.ground.events)
        order = images[start:]
        if all(a < b for a, b in pairwise(order)):
            return
        for i, later in enumerate(order):
            for j in range(i + 1, len(order)):
                if order[j] < later and self.forms[order[j]] != self.forms[later]:
                    one, other = self.schemas[start + i], self.schemas[start + j]
                    if not _independent(one, other):
                        raise Asymmetry(
                            f"event `{one.name}` fires before `{other.name}`, but their mirror "
                            "images fire in the opposite order, and the order matters",
                            other.place,
                        )


def _independent(one: g.GroundSchema, other: g.GroundSchema) -> bool:
    """Whether two events have the same result in either order."""
    if g.writes(one) & g.reads(other) or g.writes(other) & g.reads(one):
        return False
    ways: dict[int, set[Hashable]] = {}
    for effect in (*one.effects, *other.effects):
        way = effect.value if isinstance(effect, g.SetBoolean) else effect.change.group
        ways.setdefault(effect.target, set()).add(way)
    shared = g.writes(one) & g.writes(other)
    return all(len(ways[t]) == 1 and ways[t] != {"assign"} for t in shared)
