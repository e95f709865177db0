"""The search for a way to the goal where not everything that can be reached can be followed."""

from __future__ import annotations

from typing import Final

import numpy as np

from serp.model.transition_model import TransitionModel, Vector
from serp.planning.far_sight.array_graph import NO_FLUENTS
from serp.planning.far_sight.goal_kernels import SearchArrays, search
from serp.planning.far_sight.inert import inert_fluents
from serp.planning.far_sight.relaxation import RelaxedTables, relaxed
from serp.planning.far_sight.relaxation_kernels import RelaxedCosts
from serp.settings import PlannerSettings

MAX_BYTES: Final = 320_000_000
"""Most bytes in the states of a search."""


class GoalSearch:
    """Finds a way to the goal, see `serp.planning.far_sight.goal_kernels`.

    Where the world moves by itself, by processes, nothing is searched for: a long way through an
    uncertain future is worth less than its values say.

    Args:
        model: The transition model.
        settings: The accepted risk.

    Attributes:
        steps: Edges that the last search followed.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings) -> None:
        self._model = model
        self._accepted = settings.accepted_risk
        self.steps = 0
        self._relaxed: RelaxedTables | None = None
        if model.actions and not model.ground.processes:
            self._relaxed = relaxed(model.ground, model.theta.tolist())
        if self._relaxed is not None:
            self._inert = inert_fluents(model.ground)
            self.way(np.zeros(len(model.fluents)), 1)  # compiled now, not at a decision

    @property
    def goal(self) -> bool:
        """Whether there is a goal to search for."""
        return self._relaxed is not None

    def way(self, state: Vector, limit: int) -> Vector | None:
        """Return the states `[N, F]` on a way to the goal, the first and all but the last.

        The likeliest outcome of every step is followed, and no step that is not safe.

        Args:
            state: `[F]` where it begins.
            limit: Most edges to follow.

        Returns:
            None where there is no goal, or no way was found.
        """
        self.steps = 0
        if self._relaxed is None:
            return None
        model, width = self._model, len(self._model.fluents)
        actions = len(model.actions)
        inert = self._inert if model.as_written else NO_FLUENTS
        numeric = {fluent.index for fluent in model.fluents if fluent.numeric}
        number = np.float64 if numeric.difference(inert.tolist()) else np.uint8
        most = MAX_BYTES // (max(1, width) * np.dtype(number).itemsize)
        nodes = min(limit, most) + actions + 1
        tree = SearchArrays.allocate(nodes, width, inert, number)
        node = search(
            model.machine_code,
            (tuple(self._relaxed), tuple(RelaxedCosts.allocate(self._relaxed))),
            (actions, self._accepted), tuple(tree), state, limit,
        )  # fmt: skip
        self.steps = int(tree.counters[2])
        if node < 0:
            return None
        way = []
        while node >= 0:
            way.append(tree.states[node * width : (node + 1) * width])
            node = int(tree.parent[node])
        return np.array(way[::-1], dtype=np.float64)
