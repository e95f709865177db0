"""Several planners of one run, of which the strategy lets one lead at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from numpy.typing import NDArray

from serp._util.saved_state import Arrays, Saved, nested
from serp.control.protocols import ExperiencedPlanner, Planner, StatefulPlanner
from serp.model.transition_model import Vector
from serp.planning.far_sight.cell_graph import Visited
from serp.planning.forecast import Forecast


class Ensemble:
    """Partial teachers, of which one leads at a time.

    Which one, the strategy finds out: a teacher that is better in some situations or on average is
    not known beforehand (Kurenkov et al., "AC-Teach", 2019, arXiv 1909.04121).

    Args:
        members: The planners, at least one.
        best: Returns the position of the one that is best by what is known.
    """

    def __init__(self, members: list[Planner], best: Callable[[], int]) -> None:
        self._members = members
        self._best = best

    def led_by(self, member: int) -> Planner:
        """Return a planner by its position."""
        return self._members[member]

    def forecast(self, state: Vector) -> Forecast:
        """Return the forecast of the best planner for a state `[F]`."""
        return self._members[self._best()].forecast(state)

    @property
    def visited(self) -> Visited | None:
        """The visited states, for the planners that use them."""
        found = (m.visited for m in self._members if isinstance(m, ExperiencedPlanner))
        return next(found, None)

    @visited.setter
    def visited(self, visited: Visited | None) -> None:
        for member in self._members:
            if isinstance(member, ExperiencedPlanner):
                member.visited = visited

    def state_dict(self) -> tuple[Arrays, dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays: Arrays = {}
        meta: dict[str, Any] = {}
        for name, member in self._stateful():
            found, meta[name] = member.state_dict()
            arrays |= nested(name, found)
        return arrays, meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It is damaged.
        """
        saved = Saved("planners", arrays, meta)
        for name, member in self._stateful():
            member.load_state_dict(*saved.part(name))

    def _stateful(self) -> list[tuple[str, StatefulPlanner]]:
        members = enumerate(self._members)
        return [(str(k), m) for k, m in members if isinstance(m, StatefulPlanner)]
