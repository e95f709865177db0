"""Edits of one effect of a domain file."""

from __future__ import annotations

import re
from collections.abc import Sequence

from serp.diagnosis.findings import EffectTerm
from serp.diagnosis.repair.formatting import plus
from serp.pddl import syntax as x
from serp.pddl.edits import Edit
from serp.pddl.source import Place

_OPPOSITE = {x.Change.INCREASE: x.Change.DECREASE, x.Change.DECREASE: x.Change.INCREASE}
_HEAD = re.compile(r"\(\s*([^\s();]+)")


class EffectEdit:
    """An effect on a number, and its edits.

    Attributes:
        schema: Name of the action or process that contains it.
        effect: The effect.
        evidence: Comments on the edits, each with the place above which it is inserted.
    """

    def __init__(self, schema: str, effect: x.ChangeFunction) -> None:
        self.schema = schema
        self.effect = effect
        self.evidence: list[tuple[Place, str]] = []
        self._change = effect.change
        self._numbers: dict[int, tuple[Place, str]] = {}
        self._added: tuple[EffectTerm, ...] = ()

    def set_number(self, place: Place, number: str) -> None:
        """Replace a number of the value."""
        self._numbers[place.start] = place, number

    def make_increase(self) -> None:
        """Turn an assignment into an increase by the assigned value."""
        self._change = x.Change.INCREASE
        value = self.effect.value
        if isinstance(value, x.Number):  # which may be negative
            self._numbers.setdefault(value.place.start, (value.place, value.place.text))

    def add_terms(self, terms: Sequence[EffectTerm]) -> None:
        """Add terms to the value of an assignment."""
        self._added = tuple(terms)

    def edits(self) -> list[Edit]:
        """Return the edits; a negative factor exchanges `increase` and `decrease`."""
        change = self._change
        edits = []
        for place, number in self._numbers.values():
            bare = number.removeprefix("-")
            if bare != number and change in _OPPOSITE and _is_factor(self.effect.value, place):
                change, number = _OPPOSITE[change], bare
            if number != place.text:
                edits.append(Edit(place.start, place.end, number))
        if change is not self.effect.change:
            source, start = self.effect.place.source, self.effect.place.start
            head = _HEAD.match(source.text, start)
            assert head is not None
            edits.append(Edit(head.start(1), head.end(1), change.value))
        if self._added:
            start, end = self.effect.value.place.start, self.effect.value.place.end
            before, after = plus("\n", self._added).split("\n")
            edits += [Edit(start, start, before), Edit(end, end, after)]
        return edits


def _is_factor(value: x.Expression, place: Place) -> bool:
    """Return whether a value is a number, or a product with it."""
    if isinstance(value, x.Number):
        return value.place.start == place.start
    return (
        isinstance(value, x.Arithmetic)
        and value.operator in ("*", "/")
        and any(_is_factor(operand, place) for operand in value.operands)
    )
