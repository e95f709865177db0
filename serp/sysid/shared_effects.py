"""Saying once, of the world, what several actions were found to have in common."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from serp.sysid.added_effects import AddedEffect
from serp.sysid.lifted_features import WORLD, Lifted, Lifting

_ALIKE = 0.1  # of the larger coefficient


def merged(
    lifting: Lifting, coefficients: Mapping[AddedEffect, float]
) -> Iterator[tuple[list[AddedEffect], AddedEffect]]:
    """Yield terms of different schemas that are about equal, and the world's term for all of them.

    Whether that is as good is to be found out: it goes on after the other actions as well, and
    with all objects of a type.

    Args:
        lifting: The names of the file.
        coefficients: Addition → its coefficient.
    """
    groups: dict[tuple[str, tuple[str, ...]], list[AddedEffect]] = {}
    for addition in coefficients:
        symbols = tuple(f.symbol for f in addition.factors)
        groups.setdefault((addition.target.symbol, symbols), []).append(addition)
    for group in groups.values():
        if any(addition.schema == WORLD for addition in group):
            continue
        alike = max((_alike(one, group, coefficients) for one in group), key=len)
        general = _of_the_world(lifting, alike[0])
        if len({addition.schema for addition in alike}) > 1 and general is not None:
            yield alike, general


def _alike(
    one: AddedEffect, group: list[AddedEffect], coefficients: Mapping[AddedEffect, float]
) -> list[AddedEffect]:
    """Return the terms of a group whose coefficients are about that of one of them."""
    value = coefficients[one]
    return [
        other
        for other in group
        if abs(coefficients[other] - value) <= _ALIKE * max(abs(coefficients[other]), abs(value))
    ]


def _of_the_world(lifting: Lifting, addition: AddedEffect) -> AddedEffect | None:
    """Return the same term of the world by itself; None where that cannot be said."""
    lens = lifting.world(addition.target.symbol)
    (target,) = lens.targets
    names = dict(zip(addition.target.terms, target.terms, strict=True))
    factors = tuple(
        Lifted(factor.symbol, tuple(names.get(term, term) for term in factor.terms))
        for factor in addition.factors
    )
    if not set(factors) <= set(lens.view):
        return None
    return AddedEffect(WORLD, target, factors)
