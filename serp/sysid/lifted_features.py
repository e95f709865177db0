"""Fluents by the names that a schema gives them: `battery ?robot` instead of `battery r2`.

What is found of one instance of a schema holds of all, so effects are looked for, counted and
written in terms of the schema's variables, the constants of the domain and nothing else.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from serp.model import ground as g
from serp.pddl.syntax import Kind

_MOST_IN_VIEW = 60
WORLD = ""
"""The name of no action schema: what happens whatever the action."""


@dataclass(frozen=True, order=True)
class Lifted:
    """A function or predicate applied to variables and constants.

    Attributes:
        symbol: Its name.
        terms: Variables (`?robot`) and names of constants.
    """

    symbol: str
    terms: tuple[str, ...]

    @property
    def name(self) -> str:
        """As it is printed: `battery ?robot`."""
        return " ".join((self.symbol, *self.terms))


@dataclass(frozen=True)
class Lens:
    """What one schema, or the world by itself, sees of a state.

    Attributes:
        schema: Name of the action schema, or `WORLD`.
        bindings: Position of a ground action (for the world: column of the fluent that changes)
            → variable → object.
        view: The fluents that can be named here.
        targets: Those that may be said to change.
    """

    schema: str
    bindings: Mapping[int, Mapping[str, str]]
    view: tuple[Lifted, ...]
    targets: tuple[Lifted, ...]


class Lifting:
    """Names the fluents of a ground model as its domain file would.

    Args:
        ground: A model with at least one action.
    """

    def __init__(self, ground: g.GroundModel) -> None:
        self.ground = ground
        self.syntax = ground.syntax
        self.index = {fluent.key: fluent.index for fluent in ground.fluents}
        self._constants = tuple(self.syntax.constants)
        self._lenses: dict[tuple[str, str], Lens] = {}

    def column(self, lifted: Lifted, binding: Mapping[str, str]) -> int:
        """Return the column that is meant under a binding."""
        return self.index[lifted.symbol, *(binding.get(t, t) for t in lifted.terms)]

    def schema(self, name: str) -> Lens:
        """Return what an action schema sees."""
        if (name, "") not in self._lenses:
            self._lenses[name, ""] = self._schema(name)
        return self._lenses[name, ""]

    def world(self, symbol: str) -> Lens:
        """Return what can be said of the change of a function by itself."""
        if (WORLD, symbol) not in self._lenses:
            self._lenses[WORLD, symbol] = self._world(symbol)
        return self._lenses[WORLD, symbol]

    def _schema(self, name: str) -> Lens:
        variables = next(
            s.parameters for s in self.syntax.schemas if s.kind is Kind.ACTION and s.name == name
        )
        bindings = {
            position: dict(zip((v.name for v in variables), action.arguments, strict=True))
            for position, action in enumerate(self.ground.actions)
            if action.schema == name
        }
        view = self._view([v.name for v in variables], list(bindings.values()))
        return Lens(name, bindings, view, tuple(v for v in view if self._numeric(v)))

    def _world(self, symbol: str) -> Lens:
        variables = [p.name for p in self.syntax.declarations[symbol].parameters]
        bindings = {
            f.index: dict(zip(variables, f.arguments, strict=True))
            for f in self.ground.fluents
            if f.symbol == symbol
        }
        view = self._view(variables, list(bindings.values()))
        return Lens(WORLD, bindings, view, (Lifted(symbol, tuple(variables)),))

    def _view(
        self, variables: Sequence[str], bindings: Sequence[Mapping[str, str]]
    ) -> tuple[Lifted, ...]:
        """Return the fluents that exist under every binding, those of fewest terms first."""
        found: list[Lifted] = []
        places = {f.symbol: len(f.arguments) for f in self.ground.fluents}
        for symbol, number in sorted(places.items(), key=lambda item: item[1]):
            for terms in itertools.product((*variables, *self._constants), repeat=number):
                if len(found) >= _MOST_IN_VIEW:
                    return tuple(found)
                lifted = Lifted(symbol, terms)
                if all((symbol, *(b.get(t, t) for t in terms)) in self.index for b in bindings):
                    found.append(lifted)
        return tuple(found)

    def _numeric(self, lifted: Lifted) -> bool:
        return self.syntax.declarations[lifted.symbol].numeric


def features(
    lifting: Lifting,
    lens: Lens,
    factors: tuple[Lifted, ...],
    states: NDArray[np.float64],
    keys: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Return the product of some fluents, `[n]`.

    Args:
        lifting: The names of the file.
        lens: Whose words the factors are in.
        factors: The fluents; none for the constant 1.
        states: `[n, F]`.
        keys: `[n]` key of the binding that holds in each row; of the rows whose key is none of
            the lens the feature is 0.
    """
    values = np.zeros(len(states))
    for key in np.unique(keys):
        binding = lens.bindings.get(int(key))
        if binding is None:
            continue
        rows = keys == key
        columns = [lifting.column(f, binding) for f in factors]
        values[rows] = states[rows][:, columns].prod(1)
    return values
