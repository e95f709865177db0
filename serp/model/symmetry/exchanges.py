"""Finding the objects of a model that can be exchanged for one another."""

from __future__ import annotations

from dataclasses import dataclass

from serp.model import ground as g
from serp.model.symmetry.model_symmetry import ModelSymmetry
from serp.model.symmetry.permutation import Asymmetry, Permutations

MAX_WORK = 1_000_000
"""Fluents and schemas that are mirrored before the search gives up; about a second."""


@dataclass(frozen=True)
class Exchanges:
    """The result of the search.

    Attributes:
        symmetries: Exchanges of two objects, which generate all others.
        complete: False where the search was cut short: there may be more.
    """

    symmetries: tuple[ModelSymmetry, ...]
    complete: bool

    def described(self) -> list[str]:
        """Return them in words; objects that are all interchangeable are listed together."""
        classes: dict[str, list[str]] = {}
        for symmetry in self.symmetries:
            first, other = symmetry.objects
            classes.setdefault(first, [first]).append(other)
        return [
            " <-> ".join(c) if len(c) == 2 else f"{', '.join(c)} in any order"
            for c in classes.values()
        ]


def find_exchanges(ground: g.GroundModel, max_work: int = MAX_WORK) -> Exchanges:
    """Find the pairs of objects whose exchange maps a model onto itself; deterministic.

    Exchangeability is an equivalence, so each object is compared with one of each class.
    """
    permutations = Permutations(ground)
    each = len(ground.fluents) + len(ground.schemas)
    classes: list[tuple[str, list[tuple[str, int]]]] = []
    found: list[ModelSymmetry] = []
    for name, roles in _roles(permutations).items():
        for first, its_roles in classes:
            if roles != its_roles:
                continue
            max_work -= each
            if max_work < 0:
                return Exchanges(tuple(found), complete=False)
            try:
                symmetry = permutations.symmetry({first: name, name: first})
            except Asymmetry:
                continue
            if not symmetry.trivial:
                found.append(symmetry)
            break
        else:
            classes.append((name, roles))
    return Exchanges(tuple(found), complete=True)


def _roles(permutations: Permutations) -> dict[str, list[tuple[str, int]]]:
    """Return, for each object in the order of appearance, where it stands in names."""
    ground = permutations.ground
    roles: dict[str, list[tuple[str, int]]] = {}
    for symbol, *arguments in (
        *(fluent.key for fluent in ground.fluents),
        *((schema.schema, *schema.arguments) for schema in ground.schemas),
        *permutations.static,
    ):
        for position, name in enumerate(arguments):
            roles.setdefault(name, []).append((symbol, position))
    return {name: sorted(places) for name, places in roles.items()}
