"""Lifted fluents, over the variables of a schema: `battery ?robot` instead of `battery r2`.

An estimate for one instance of a schema applies to all of them, so effects are searched, fitted and
written with the schema's variables and the constants of the domain.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from serp.model import ground as g
from serp.model.transition_model import Vector
from serp.pddl.syntax import Kind

_MAX_FLUENTS = 60  # most lifted fluents of one scope; the search for effects is quadratic in them

WORLD = ""
"""In place of an action schema's name: an effect under every action, as of a process."""


@dataclass(frozen=True, order=True)
class LiftedFluent:
    """A function or predicate applied to variables (`?robot`) and constants."""

    symbol: str
    terms: tuple[str, ...]

    @property
    def name(self) -> str:
        """As it is printed: `battery ?robot`."""
        return " ".join((self.symbol, *self.terms))


@dataclass(frozen=True)
class LiftedScope:
    """The fluents that can be named in an action schema, or in the world (`WORLD`).

    `bindings` map variables to objects for each ground action, by position; for the world, for
    each fluent that changes, by column. `targets` are the fluents that an effect can change.
    """

    schema: str
    bindings: Mapping[int, Mapping[str, str]]
    fluents: tuple[LiftedFluent, ...]
    targets: tuple[LiftedFluent, ...]


class LiftedModel:
    """Maps between the fluents of a ground model and the lifted fluents of its domain file.

    Args:
        ground: A model with at least one action.
    """

    def __init__(self, ground: g.GroundModel) -> None:
        self.ground = ground
        self.syntax = ground.syntax
        self._index = {fluent.key: fluent.index for fluent in ground.fluents}
        self.schema = functools.cache(self._schema)
        self.world = functools.cache(self._world)

    def column(self, fluent: LiftedFluent, binding: Mapping[str, str]) -> int:
        """Return the column of the state that a lifted fluent denotes under a binding."""
        return self._index[fluent.symbol, *(binding.get(t, t) for t in fluent.terms)]

    def numeric(self, fluent: LiftedFluent) -> bool:
        """Return whether it is a function, not a predicate."""
        return self.syntax.declarations[fluent.symbol].numeric

    def products(
        self,
        scope: LiftedScope,
        factors: tuple[LiftedFluent, ...],
        states: Vector,
        keys: NDArray[np.int64],
    ) -> Vector:
        """Return the product of the factors in states `[n, F]`, 1 without any, `[n]`.

        `keys` `[n]` are those of the binding of each row; the product is 0 where the scope has no
        such binding.
        """
        values = np.zeros(len(states))
        for key in np.unique(keys):
            binding = scope.bindings.get(int(key))
            if binding is None:
                continue
            rows = keys == key
            columns = [self.column(f, binding) for f in factors]
            values[rows] = states[rows][:, columns].prod(1)
        return values

    def _schema(self, name: str) -> LiftedScope:
        """Return the scope of an action schema."""
        variables = next(
            s.parameters for s in self.syntax.schemas if s.kind is Kind.ACTION and s.name == name
        )
        bindings = {
            position: dict(zip((v.name for v in variables), action.arguments, strict=True))
            for position, action in enumerate(self.ground.actions)
            if action.schema == name
        }
        fluents = self._fluents([v.name for v in variables], list(bindings.values()))
        return LiftedScope(name, bindings, fluents, tuple(f for f in fluents if self.numeric(f)))

    def _world(self, symbol: str) -> LiftedScope:
        """Return the scope of a process that changes the fluents of a function."""
        variables = [p.name for p in self.syntax.declarations[symbol].parameters]
        bindings = {
            f.index: dict(zip(variables, f.arguments, strict=True))
            for f in self.ground.fluents
            if f.symbol == symbol
        }
        fluents = self._fluents(variables, list(bindings.values()))
        return LiftedScope(WORLD, bindings, fluents, (LiftedFluent(symbol, tuple(variables)),))

    def _fluents(
        self, variables: Sequence[str], bindings: Sequence[Mapping[str, str]]
    ) -> tuple[LiftedFluent, ...]:
        """Return the fluents that exist under every binding, those with the fewest terms first."""
        found: list[LiftedFluent] = []
        arity = {f.symbol: len(f.arguments) for f in self.ground.fluents}
        for symbol, number in sorted(arity.items(), key=lambda item: item[1]):
            for terms in itertools.product((*variables, *self.syntax.constants), repeat=number):
                if len(found) >= _MAX_FLUENTS:
                    return tuple(found)
                if all((symbol, *(b.get(t, t) for t in terms)) in self._index for b in bindings):
                    found.append(LiftedFluent(symbol, terms))
        return tuple(found)
