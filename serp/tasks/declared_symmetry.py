"""Symmetries as a task declares them; `serp.tasks.task_symmetry` resolves them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Symmetry:
    """A transformation that leaves a task unchanged, most often a reflection.

    Soccer, where everything on the left can happen on the right::

        Symmetry(objects={"left": "right"}, observation_signs=(1, -1, 1, ...))

    Cart-pole, whose fluents are positive to the right and change their signs::

        Symmetry(
            flip=("cart-position", "cart-velocity", "pole-angle", "pole-velocity"),
            actions={"push-left": "push-right"},
            observation_signs=(-1, -1, -1, -1),
        )

    A file without objects, whose sides are predicates and functions of different names::

        Symmetry(
            fluents={"ball-left": "ball-right", "room-left": "room-right"},
            actions={"go-left": "go-right"},
        )

    An incomplete mapping is completed to a permutation: `{"left": "right"}` exchanges both,
    `{"a": "b", "b": "c"}` maps c to a.

    Attributes:
        objects: Object of the domain → its image.
        fluents: Name of a predicate or function → that of its image, for all of their fluents. The
            arguments of a fluent are exchanged as `objects` says.
        flip: Numeric fluents that change their signs.
        actions: Ground action → its image, by name. Needed if it does not follow from `objects`; an
            action that is not named is its own image. An environment action that the domain does
            not mention is given by its number.
        observation_signs: Factor 1 or -1 of each entry of the mirrored observation; None: all are
            1.
        observation_order: For each entry of the mirrored observation, the index of the original
            entry; None: the same index. If both are None, the image of an observation is unknown,
            and only a learner whose input is the state uses the symmetry.
    """

    objects: Mapping[str, str] = field(default_factory=dict)
    fluents: Mapping[str, str] = field(default_factory=dict)
    flip: Sequence[str] = ()
    actions: Mapping[str | int, str | int] = field(default_factory=dict)
    observation_signs: Sequence[float] | None = None
    observation_order: Sequence[int] | None = None

    def __str__(self) -> str:
        mappings = (self.objects, self.fluents, self.actions)
        parts = [cycles(as_permutation(mapping)) for mapping in mappings]
        parts += [f"-{name}" for name in self.flip]
        return ", ".join(text for text in parts if text) or "of the observation only"


def as_permutation(mapping: Mapping[Any, Any]) -> dict[Any, Any]:
    """Return a mapping completed to a permutation; a ValueError says why there is none."""
    if not isinstance(mapping, Mapping):
        raise ValueError(f"expected a mapping such as {{'left': 'right'}}, not {mapping!r}")
    whole = dict(mapping)
    sources = {image: source for source, image in mapping.items()}
    if len(sources) != len(mapping):
        twice = next(i for s, i in mapping.items() if sources[i] != s)
        raise ValueError(f"two things become `{twice}`")
    for end in mapping.values():
        if end not in mapping:
            start = end
            while start in sources:
                start = sources[start]
            whole[end] = start
    return whole


def cycles(mapping: Mapping[Any, Any]) -> str:
    """Return a permutation in words: `left <-> right, a -> b -> c -> a`."""
    told: list[str] = []
    seen: set[Any] = set()
    for start in mapping:
        if start in seen or mapping[start] == start:
            continue
        cycle = [start]
        while (following := mapping[cycle[-1]]) != start:
            cycle.append(following)
        seen.update(cycle)
        names = [str(name) for name in cycle]
        told.append(" <-> ".join(names) if len(cycle) == 2 else " -> ".join([*names, names[0]]))
    return ", ".join(told)
