"""The planner of a policy: what was solved to its end, else the lookahead."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .cells import CellTable
from .folder import ControllerError
from .forecast import SAFE, EnvironmentActions, Prospects
from .lookahead import LeafValues
from .step import State


class SolvedStates:
    """The predictions in every state of a planning graph that was solved at the export."""

    def __init__(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        self._inert = arrays["solved.inert"].tolist()
        states = arrays["solved.states"] + 0.0  # -0.0 equals 0.0
        self._rows = {row.tobytes(): k for k, row in enumerate(states)}
        self._choice = arrays["solved.choice"].tolist()
        names = ("value", "path_risk", "safe_steps", "reward", "flags")
        self._columns = [arrays[f"solved.{name}"] for name in names]
        if any(len(column) != len(states) for column in (self._choice, *self._columns)):
            raise ControllerError("the solved states of the policy are damaged")

    def find(self, state: State) -> Prospects | None:
        """Return the predictions for ground actions; None for a state that was not solved."""
        row = np.array(state) + 0.0
        row[self._inert] = 0.0
        place = self._rows.get(row.tobytes())
        if place is None:
            return None
        return Prospects(self._choice[place], *(column[place].tolist() for column in self._columns))


class FrozenPlanner:
    """The planner as it was at the export.

    Args:
        data: Its settings.
        arrays: Solved states and cells, where there are any.
        search: The lookahead's predictions for a state.
        periods: Discounted control periods of an edge.
        actions: The environment's actions.
        learns: Whether the values of visited cells are updated, as serp's planner does. Without it
            a prediction depends on nothing but the state.
    """

    def __init__(
        self,
        data: Mapping[str, Any],
        arrays: Mapping[str, NDArray[Any]],
        search: Callable[[State, LeafValues | None], Prospects],
        periods: float,
        actions: EnvironmentActions,
        learns: bool,
    ) -> None:
        self._search, self._periods = search, periods
        self._actions, self._learns = actions, learns
        self._solved = SolvedStates(arrays) if data["solved"] else None
        self._cells = CellTable(arrays) if data["cells"] else None
        self._favoured = bool(data["favoured"])

    def solved(self, state: State) -> Prospects | None:
        """Return the predictions for environment actions in a solved state; None elsewhere."""
        found = None if self._solved is None else self._solved.find(state)
        return None if found is None else self._actions.project(found)

    def forecast(self, state: State) -> Prospects:
        """Return the lookahead's predictions for environment actions."""
        return self._actions.project(self._near(state))

    def _near(self, state: State) -> Prospects:
        cells = self._cells
        if cells is None:
            return self._search(state, None)
        if not self._favoured:
            found = self._search(state, None)
            if not found.sees_costs_alone(self._periods):
                return found
        found = self._search(state, cells.values)
        if self._learns and found.complete and found.choice >= 0:
            safe = found.safe_steps[found.choice] == SAFE
            if safe:
                cells.set_value(state, found.value[found.choice])
        return found
