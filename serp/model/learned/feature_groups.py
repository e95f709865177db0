"""The inputs and targets of what is learned, and the weights of a regression."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from serp._core import Regression
from serp.model.ground_model import Fluent, GroundModel, GroundSchema

Key = tuple[str, ...]


@dataclass(frozen=True)
class FeatureGroup:
    """Inputs and targets of a model of one ground action's effect on some objects.

    Groups with equal keys are instances of the same relation between different objects of the same
    types; they share one model. Columns are in an order that is the same for the key.
    """

    key: Key  # schema, roles of the objects, symbols of inputs and targets
    inputs: tuple[int, ...]  # columns that the change may depend on
    targets: tuple[int, ...]  # columns of the numeric fluents that may change
    predicates: tuple[int, ...]  # columns of the predicates that may change
    predicate_inputs: tuple[int, ...]  # positions of predicates within `inputs`


def feature_groups_of(model: GroundModel, action: GroundSchema) -> tuple[FeatureGroup, ...]:
    """Return the feature groups of a ground action.

    The first one is that of the action's own objects; there is another for each other tuple of
    objects with numeric fluents. Its inputs are all fluents of these objects and of the action's.
    Roles distinguish the objects: the position among the action's arguments, or in the tuple.
    """
    own = set(action.arguments)
    of_object = model.fluents_of_objects
    inner = {f.index: f for thing in ("", *own) for f in of_object.get(thing, ())
             if own.issuperset(f.arguments)}  # fmt: skip
    tuples: dict[tuple[str, ...], list[Fluent]] = {(): [inner[index] for index in sorted(inner)]}
    tuples |= {o: f for o, f in model.numeric_tuples.items() if not own.issuperset(o)}
    return tuple(
        _group(model, action, objects, fluents, of_object)
        for objects, fluents in tuples.items()
        if fluents
    )


def _group(
    model: GroundModel,
    action: GroundSchema,
    objects: tuple[str, ...],
    changing: Sequence[Fluent],
    of_object: Mapping[str, Sequence[Fluent]],
) -> FeatureGroup:
    """Return the group of some objects; `of_object` are the fluents of each, and of none."""
    roles: dict[str, str] = {}
    for place, thing in enumerate(action.arguments):
        roles.setdefault(thing, f"a{place}")
    for place, thing in enumerate(objects):
        roles.setdefault(thing, f"t{place}")

    def by_roles(fluent: Fluent) -> str:
        return f"{fluent.symbol}({','.join(roles[thing] for thing in fluent.arguments)})"

    near = {f.index: f for thing in ("", *roles) for f in of_object.get(thing, ())}
    seen = sorted(
        (by_roles(fluent), fluent.index)
        for fluent in near.values()
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


RANGE: Final = Regression.RANGE
"""Normalised inputs larger than this are outside of the range of the data; if samples have them,
all are normalised anew."""
SMOOTH, FEATURES = Regression.SMOOTH, Regression.FEATURES
"""Numbers of random Fourier features: of a smooth model and of a full one."""
_MAX_INPUTS, _MAX_COLUMNS = 96, 640
"""Most inputs of a regression, and most columns of its linear part, which is solved often."""

FILE, LINEAR, CURVED, FULL = range(4)
"""The predictor of a fluent: the file alone, or the file with a linear model, one with the
smoothest random features, or one with all of them."""

WEIGHTS: Final = (
    "linear", "amplitude", "centre", "shrink", "frequency", "phase", "inverse", "typical", "scale",
)  # fmt: skip
"""Arrays of a regression."""


def learnable(depth: int, heads: int) -> bool:
    """Return whether a regression has few enough inputs to learn from."""
    return depth <= _MAX_INPUTS and (1 + heads) * (1 + depth) <= _MAX_COLUMNS
