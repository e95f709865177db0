"""The planner of a policy: what was solved to its end, else the lookahead."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .cells import CellTable
from .forecast import SAFE, EnvironmentActions, Prospects
from .lookahead import LeafValues, SearchLimits
from .reading import Arrays, Entry
from .step import State


class SolvedStates:
    """The predictions in every state of a planning graph that was solved at the export."""

    def __init__(self, arrays: Arrays, width: int, actions: int) -> None:
        found = arrays.under("solved.")
        self._inert = found.whole("inert", 0, width - 1, None).tolist()
        states = found.numbers("states", None, width) + 0.0  # -0.0 equals 0.0
        self._rows = {row.tobytes(): k for k, row in enumerate(states)}
        count = len(states)
        self._choice = found.whole("choice", -1, actions - 1, count).tolist()
        self._columns = [
            found.numbers("value", count, actions, finite=False),  # -inf: not applicable
            found.numbers("path_risk", count, actions),
            found.whole("safe_steps", -1, None, count, actions),
            found.numbers("reward", count, actions),
            found.whole("flags", 0, None, count, actions),
        ]

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
        limits: Its limits.
        width: Length of a state.
        actions: The environment's actions.
        learns: Whether the values of visited cells are updated, as serp's planner does. Without it
            a prediction depends on nothing but the state.
    """

    def __init__(
        self,
        data: Entry,
        arrays: Arrays,
        search: Callable[[State, LeafValues | None], Prospects],
        limits: SearchLimits,
        width: int,
        actions: EnvironmentActions,
        learns: bool,
    ) -> None:
        self._search = search
        self._actions, self._learns = actions, learns
        self._solved: SolvedStates | None = None
        if data["solved"].truth():
            self._solved = SolvedStates(arrays, width, limits.actions)
        self._cells = CellTable(arrays, width) if data["cells"].truth() else None

    @property
    def has_solved(self) -> bool:
        """Whether there are solved states."""
        return self._solved is not None

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
        found = self._search(state, None)
        if not found.sees_costs_alone:
            return found
        found = self._search(state, cells.values)
        if self._learns and found.complete and found.choice >= 0:
            safe = found.safe_steps[found.choice] == SAFE
            if safe:
                cells.set_value(state, found.value[found.choice])
        return found
