"""Feature groups: fluents by the roles of their objects, so that similar objects share a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from serp.model.ground import Fluent, GroundModel, GroundSchema

Key = tuple[str, ...]

MAX_BITS = 6
"""Most predicates of a group with modes."""


@dataclass(frozen=True)
class FeatureGroup:
    """Inputs and targets of a model of one ground action's effect on some objects.

    Groups with equal keys are instances of the same relation between different objects of the same
    types; they share one model.

    Attributes:
        key: Schema, roles of the objects, symbols of inputs and targets.
        inputs: Columns that the change may depend on, in an order that is the same for the key.
        targets: Columns of the numeric fluents that may change, likewise ordered.
        predicates: Columns of the predicates that may change, likewise ordered.
        predicate_inputs: Positions of predicates within `inputs`.
    """

    key: Key
    inputs: tuple[int, ...]
    targets: tuple[int, ...]
    predicates: tuple[int, ...]
    predicate_inputs: tuple[int, ...]

    @property
    def bits(self) -> tuple[int, ...]:
        """Positions within `inputs` of the predicates whose values distinguish modes."""
        return self.predicate_inputs if len(self.predicate_inputs) <= MAX_BITS else ()


def feature_groups_of(model: GroundModel, action: GroundSchema) -> tuple[FeatureGroup, ...]:
    """Return the feature groups of a ground action.

    The first one is that of the action's own objects; there is another for each other tuple of
    objects with numeric fluents. Its inputs are all fluents of these objects and of the action's.
    Roles distinguish the objects: the position among the action's arguments, or in the tuple.
    """
    own = set(action.arguments)
    tuples: dict[tuple[str, ...], list[Fluent]] = {(): []}
    for fluent in model.fluents:
        objects = () if own.issuperset(fluent.arguments) else fluent.arguments
        tuples.setdefault(objects, []).append(fluent)
    return tuple(
        _group(model, action, objects, fluents)
        for objects, fluents in tuples.items()
        if (fluents if not objects else any(fluent.numeric for fluent in fluents))
    )


def _group(
    model: GroundModel, action: GroundSchema, objects: tuple[str, ...], changing: Sequence[Fluent]
) -> FeatureGroup:
    roles: dict[str, str] = {}
    for place, thing in enumerate(action.arguments):
        roles.setdefault(thing, f"a{place}")
    for place, thing in enumerate(objects):
        roles.setdefault(thing, f"t{place}")

    def by_roles(fluent: Fluent) -> str:
        return f"{fluent.symbol}({','.join(roles[thing] for thing in fluent.arguments)})"

    seen = sorted(
        (by_roles(fluent), fluent.index)
        for fluent in model.fluents
        if all(thing in roles for thing in fluent.arguments)
    )
    inputs = tuple(index for _, index in seen)
    ordered = sorted(changing, key=by_roles)
    key = (
        action.schema,
        ",".join(roles[thing] for thing in objects),
        ";".join(text for text, _ in seen),
        ";".join(map(by_roles, ordered)),
    )
    return FeatureGroup(
        key,
        inputs,
        tuple(fluent.index for fluent in ordered if fluent.numeric),
        tuple(fluent.index for fluent in ordered if not fluent.numeric),
        tuple(k for k, index in enumerate(inputs) if not model.fluents[index].numeric),
    )
