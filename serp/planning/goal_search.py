"""The search for a way to the goal where not everything that can be reached can be followed.

States are expanded in two orders in turn: those with new values, or pairs of values, among the
states that lack as many conditions of the goal come first in one, those with the least relaxed cost
in the other (best-first width search: Lipovetzky & Geffner, AAAI 2017).
"""

from __future__ import annotations

from serp._core import Relaxation, find_way
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.inert import inert_fluents
from serp.planning.relaxation import relaxed
from serp.settings import PlannerSettings


class GoalSearch:
    """Finds a way to the goal, see `serp.planning.goal_search`.

    Where the world moves by itself, by processes, nothing is searched for: a long way through an
    uncertain future is worth less than its values say.

    Attributes:
        steps: Edges that the last search followed.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings) -> None:
        self._model = model
        self._accepted = settings.accepted_risk
        self.steps = 0
        self._relaxed: Relaxation | None = None
        if model.actions and not model.ground.processes:
            self._relaxed = relaxed(model.ground, model.theta.tolist())

    @property
    def goal(self) -> bool:
        """Whether there is a goal to search for."""
        return self._relaxed is not None

    def way(self, state: Vector, limit: int) -> Vector | None:
        """Return the states `[N, F]` on a way from a state `[F]` to the goal, but the last one.

        The likeliest outcome of every step is followed, no step that is not safe, and at most
        `limit` edges. None where there is no goal, or no way was found.
        """
        self.steps = 0
        if self._relaxed is None:
            return None
        model = self._model
        inert = inert_fluents(model)
        numeric = {fluent.index for fluent in model.fluents if fluent.numeric}
        self.steps, way = find_way(
            model.core, self._relaxed, inert, numeric <= set(inert.tolist()), self._accepted,
            state, limit,
        )  # fmt: skip
        return way
