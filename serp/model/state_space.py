"""States and actions of a model by name, with checks of values from outside."""

from __future__ import annotations

import operator
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from serp._util.did_you_mean import did_you_mean, listed
from serp.errors import SerpError
from serp.model.ground_model import Fluent, GroundModel, GroundSchema, Parameter

Vector = NDArray[np.float64]


class StateError(SerpError):
    """A state or an action does not fit the model."""


class StateSpace:
    """The states and actions of a ground model."""

    def __init__(self, ground: GroundModel) -> None:
        self.ground = ground
        self._index = {fluent.name: fluent.index for fluent in ground.fluents}
        self._actions = {action.name: k for k, action in enumerate(ground.actions)}

    @property
    def fluents(self) -> tuple[Fluent, ...]:
        """The columns of a state."""
        return self.ground.fluents

    @property
    def actions(self) -> tuple[GroundSchema, ...]:
        """The ground actions, in file order."""
        return self.ground.actions

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The numbers of the files, with role and place; θ holds their values."""
        return self.ground.parameters

    def state(self, values: Mapping[str, float | bool]) -> Vector:
        """Return the state with the named values.

        Args:
            values: Fluent name → value, for every fluent.

        Raises:
            StateError: A fluent is missing, unknown, or its value is not a finite number.
        """
        if not isinstance(values, Mapping):
            raise StateError(f"a state must map fluent names to values, not {values!r}")
        if values.keys() != self._index.keys():
            self.check_names(values)
        state = np.empty(len(self.fluents))
        for name, value in values.items():
            try:
                if isinstance(value, _NOT_NUMBERS):
                    raise TypeError
                state[self._index[name]] = value
            except (TypeError, ValueError):
                raise StateError(
                    f"the value of fluent `{name}` is not a number: {value!r}"
                ) from None
        return self.check_state(state)

    def values(self, state: Sequence[float] | Vector) -> dict[str, float | bool]:
        """Return a state as fluent name → value (bool for predicates)."""
        return {
            f.name: float(state[f.index]) if f.numeric else bool(state[f.index])
            for f in self.fluents
        }

    def check_names(self, names: Collection[str]) -> None:
        """Check that the names are those of the fluents."""
        for name in names:
            if name not in self._index:
                raise StateError(self._unknown_fluent(str(name)))
        missing = listed(f.name for f in self.fluents if f.name not in names)
        if missing:
            raise StateError(
                f"no value for fluent {missing}; values are given for "
                f"{listed(map(str, names)) or 'none'}"
            )

    def _unknown_fluent(self, name: str) -> str:
        if name in self.ground.static:
            return (
                f"`{name}` is fixed, because `:init` gives its value and no effect changes it; "
                "leave it out here, or remove it from `:init`"
            )
        return f"unknown fluent `{name}`; {did_you_mean(name, self._index)}"

    def check_state(self, state: ArrayLike) -> Vector:
        """Return the state as float64 `[F]`.

        Raises:
            StateError: The shape is wrong, or a value is NaN, infinite, or, for a predicate,
                neither 0 nor 1.
        """
        vector = self.check_shape(state)
        for fluent, value in zip(self.fluents, vector.tolist(), strict=True):
            if value - value != 0.0:
                raise StateError(f"fluent `{fluent.name}` must be a finite number, not {value}")
            if not fluent.numeric and value not in (0.0, 1.0):
                raise StateError(f"predicate `{fluent.name}` must be 0 or 1, not {value}")
        return vector

    def check_shape(self, values: ArrayLike) -> Vector:
        """Return numbers as float64 `[F]`, without a check of the values."""
        state = numbers(values, "a state")
        wanted = len(self.fluents)
        if state.shape == (wanted,):
            return state
        size = f"a state of this domain has {wanted} number{'' if wanted == 1 else 's'}"
        if state.ndim != 1:
            raise StateError(f"{size} in one row, not the shape {state.shape}")
        names = [f.name for f in self.fluents]
        if len(state) < wanted:
            what = f"none for {listed(names[len(state) :])}"
        else:
            what = f"{len(state) - wanted} more than the fluents {listed(names)}; drop the excess, "
            what += "or declare more fluents"
        raise StateError(f"{size} in the order of its fluents, found {len(state)}: {what}")

    def action_index(self, action: int | str) -> int:
        """Return the position of a ground action given by name or position.

        Raises:
            StateError: There is no such action.
        """
        if isinstance(action, bool | np.bool_):
            raise StateError(f"an action must be a name or a position, not {action!r}")
        if isinstance(action, str):
            name = " ".join(action.lower().strip("() ").split())
            if name not in self._actions:
                raise StateError(f"unknown action `{name}`; {did_you_mean(name, self._actions)}")
            return self._actions[name]
        try:
            index = operator.index(action)
        except TypeError:
            raise StateError(f"an action must be a name or a position, not {action!r}") from None
        return self.check_action(index, 0)

    def check_action(self, action: int, least: int) -> int:
        """Return the position of an action."""
        if not least <= action < len(self.actions):
            last = len(self.actions) - 1
            raise StateError(f"there is no action {action}; actions are numbered 0 to {last}")
        return action

    def check_batch(self, states: Vector, action: Any) -> NDArray[np.int64]:
        """Return the actions of a batch of states `[B, F]` as positions `[B]`."""
        batch, width = states.shape
        if width != len(self.fluents):
            raise StateError(
                f"a state of this domain has {len(self.fluents)} numbers, found {width} columns"
            )
        given = np.asarray(self.action_index(action) if isinstance(action, str) else action)
        if given.shape not in ((), (batch,)) or (given.size and given.dtype.kind not in "iu"):
            raise StateError(f"expected {batch} positions of actions, found {action!r}")
        actions = np.broadcast_to(given.astype(np.int64), (batch,))
        if batch and (actions.min() < 0 or actions.max() >= len(self.actions)):
            raise StateError(f"positions of actions must be from 0 to {len(self.actions) - 1}")
        return actions


def numbers(values: ArrayLike, what: str) -> Vector:
    """Return numbers as float64."""
    try:
        array = np.asarray(values)
    except ValueError:  # lists of different lengths
        array = np.asarray(None)
    if array.dtype.kind not in "biuf":
        hint = "; is a `return` missing?" if values is None else ""
        raise StateError(f"{what} must consist of numbers, found {values!r}{hint}")
    return array.astype(np.float64, copy=False)


_NOT_NUMBERS = (str, bytes, complex, np.complexfloating)
"""What NumPy would convert to a number."""
