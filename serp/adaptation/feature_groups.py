"""What a correction looks at: fluents by the roles of objects, so that like shares with like."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from serp.model.ground import Fluent, GroundModel, GroundSchema

Key = tuple[str, ...]

MOST_BITS = 6
"""Of more predicates than that in one view no modes are made."""


@dataclass(frozen=True)
class FeatureGroup:
    """What one ground action may do to the fluents of one tuple of objects, or of its own objects.

    Views with equal keys are instances of the same thing, said of other objects of the same type,
    and share one model.

    Attributes:
        key: Schema, roles of the objects, and the symbols in view.
        inputs: Columns that the change may depend on, in an order that is the same for the key.
        targets: Columns of the numeric fluents that may change, in such an order too.
        predicates: Columns of the predicates that may change, likewise.
        truths: Positions within `inputs` of predicates.
    """

    key: Key
    inputs: tuple[int, ...]
    targets: tuple[int, ...]
    predicates: tuple[int, ...]
    truths: tuple[int, ...]

    @property
    def bits(self) -> tuple[int, ...]:
        """Positions within `inputs` of the predicates whose truth makes a mode."""
        return self.truths if len(self.truths) <= MOST_BITS else ()


def feature_groups_of(model: GroundModel, action: GroundSchema) -> tuple[FeatureGroup, ...]:
    """Return the views of a ground action: that of its own objects, then one for each other tuple.

    A view of a tuple of objects sees every fluent about these objects and the action's own; which
    of them is which is told by its role: place among the action's arguments, or in the tuple. Of
    tuples that are not the action's own only those with numeric fluents are in view.
    """
    own = set(action.arguments)
    things: dict[tuple[str, ...], list[Fluent]] = {(): []}
    for fluent in model.fluents:
        things.setdefault(() if own.issuperset(fluent.arguments) else fluent.arguments, []).append(
            fluent
        )
    return tuple(
        _view(model, action, about, fluents)
        for about, fluents in things.items()
        if (fluents if not about else any(fluent.numeric for fluent in fluents))
    )


def _view(
    model: GroundModel, action: GroundSchema, about: tuple[str, ...], changing: Sequence[Fluent]
) -> FeatureGroup:
    roles: dict[str, str] = {}
    for place, thing in enumerate(action.arguments):
        roles.setdefault(thing, f"a{place}")
    for place, thing in enumerate(about):
        roles.setdefault(thing, f"t{place}")

    def said(fluent: Fluent) -> str:
        return f"{fluent.symbol}({','.join(roles[thing] for thing in fluent.arguments)})"

    seen = sorted(
        (said(fluent), fluent.index)
        for fluent in model.fluents
        if all(thing in roles for thing in fluent.arguments)
    )
    inputs = tuple(index for _, index in seen)
    ordered = sorted(changing, key=said)
    key = (
        action.schema,
        ",".join(roles[thing] for thing in about),
        ";".join(text for text, _ in seen),
        ";".join(map(said, ordered)),
    )
    return FeatureGroup(
        key,
        inputs,
        tuple(fluent.index for fluent in ordered if fluent.numeric),
        tuple(fluent.index for fluent in ordered if not fluent.numeric),
        tuple(k for k, index in enumerate(inputs) if not model.fluents[index].numeric),
    )
