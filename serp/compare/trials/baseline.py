"""The learner alone, as the line to beat: no planner, no veto."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from serp.control.arbiter import Arbiter, Decision
from serp.control.strategies.strategy import Learner, Proposed
from serp.model.transition_model import Vector
from serp.planning.action_map import ActionForecast


class Unguarded(Arbiter):
    """Executes whatever the learner proposes. The guarantee of `Arbiter` does not hold.

    The model is asked all the same, so that what it predicts unsafe is counted.
    """

    def admissible(self, forecast: ActionForecast) -> NDArray[np.bool_]:
        """Return `[E]` True: nothing is refused."""
        return np.ones(self.actions.size, dtype=np.bool_)

    def decide(self, state: Vector, learner: Learner) -> Decision:
        """Let the learner's proposal be executed, exploration included."""
        situation = self._situation(state)
        return self._accept(situation, learner.propose(None))

    def judge_proposal(self, state: Vector, proposal: Proposed) -> Decision:
        """Let a proposal be executed."""
        return self._accept(self._situation(state), proposal)

    def _explorable(
        self, forecast: ActionForecast, admissible: NDArray[np.bool_]
    ) -> NDArray[np.bool_] | None:
        return None
