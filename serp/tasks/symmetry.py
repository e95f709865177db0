"""Symmetries as a task declares them; `serp.tasks.task_symmetry` resolves them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from serp.model.symmetry.model_symmetry import cycles


@dataclass(frozen=True, kw_only=True)
class Symmetry:
    """A transformation that a task looks the same under, most often a mirror.

    Soccer, where everything on the left can happen on the right::

        Symmetry(objects={"left": "right"}, observation_signs=(1, -1, 1, ...))

    Cart-pole, whose fluents are positive to the right and change their signs::

        Symmetry(
            flip=("cart-position", "cart-velocity", "pole-angle", "pole-velocity"),
            actions={"push-left": "push-right"},
            observation_signs=(-1, -1, -1, -1),
        )

    A mapping that does not come back to where it began is closed: `{"left": "right"}` exchanges
    both, `{"a": "b", "b": "c"}` sends c to a.

    Attributes:
        objects: Object of the domain → the object that takes its place in the mirror.
        flip: Numeric fluents that change their signs.
        actions: Ground action → its mirror image, by name. Needed where `objects` does not tell; an
            action that is not named has none but itself. An environment action that the domain does
            not mention goes by its number.
        observation_signs: Sign of every number of the mirrored observation; None: all are 1.
        observation_order: Which number of the observation stands in every place of the mirrored
            one, before its sign; None: its own. Without both, it is not known how an observation
            looks in the mirror, and only a learner that sees the state alone uses the symmetry.
    """

    objects: Mapping[str, str] = field(default_factory=dict)
    flip: Sequence[str] = ()
    actions: Mapping[str | int, str | int] = field(default_factory=dict)
    observation_signs: Sequence[float] | None = None
    observation_order: Sequence[int] | None = None

    def __str__(self) -> str:
        told = [cycles(closed(self.objects)), cycles(closed(self.actions))]
        told += [f"-{name}" for name in self.flip]
        return ", ".join(text for text in told if text) or "of the observation alone"


def closed(mapping: Mapping[Any, Any]) -> dict[Any, Any]:
    """Return a permutation, chains of it closed.

    Raises:
        ValueError: Two things have the same image, or it is not a mapping.
    """
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
