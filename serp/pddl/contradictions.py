"""Refusing effects that can never happen together.

Increases and decreases of one function commute, and so do scalings. An assignment beside either, or
one beside the other, has no defined result (PDDL 2.1, definition 8), so a schema that always has
both could never be applied.
"""

from __future__ import annotations

from serp.pddl import syntax as x
from serp.pddl.source import DomainError


def refuse_contradictions(effects: tuple[x.Effect, ...]) -> None:
    """Check effects that happen together, and those under each `when` and `forall`.

    Effects whose conditions or objects differ may exclude each other: what they come to is found
    out when they are applied.
    """
    changes: dict[tuple[str, ...], list[x.ChangeFunction]] = {}
    for effect in effects:
        match effect:
            case x.When(_, inner) | x.ForallEffect(_, inner):
                refuse_contradictions(inner)
            case x.ChangeFunction(_, function):
                key = (function.name, *(argument.name for argument in function.arguments))
                for first in changes.setdefault(key, []):
                    if _contradict(first, effect):
                        raise DomainError(
                            f"`{effect.place.text}` contradicts `{first.place.text}` in line "
                            f"{first.place.line}: both would have to happen at once",
                            effect.place,
                            "write one effect, or put them under conditions that exclude each "
                            "other (`when`)",
                            code="contradictory-effects",
                        )
                changes[key].append(effect)


def _contradict(first: x.ChangeFunction, second: x.ChangeFunction) -> bool:
    if first.change.group != second.change.group:
        return True
    one, other = first.value, second.value
    if (
        first.change is x.Change.ASSIGN
        and isinstance(one, x.Number)
        and isinstance(other, x.Number)
    ):
        return one.value != other.value
    return False
