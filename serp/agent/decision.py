"""The record of one decision: the action, its actor, the reason and the predictions."""

from __future__ import annotations

from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp.model.flags import APPLICABLE, RISKY, UNSAFE, risk_of
from serp.planning.forecast import Bound
from serp.tasks.action_map import ActionForecast

_BOUNDS: Final = tuple(bound.name.lower() for bound in Bound)


class Actor(StrEnum):
    """Who proposed or executed an action."""

    PLANNER = "planner"
    LEARNER = "learner"
    EXPLORATION = "exploration"
    FALLBACK = "fallback"


class Reason(StrEnum):
    """Why the executed action was executed."""

    PLANNER_TURN = "planner's turn"
    LITTLE_TRIED = "planner explores a rarely tried action"
    ACCEPTED = "proposal accepted"
    NOT_APPLICABLE = "proposal not applicable"
    UNDEFINED = "proposal has no defined result"
    UNSAFE = "proposal predicted unsafe"
    TOO_RISKY = "proposal predicted too risky"
    UNSAFE_AHEAD = "proposal predicted to make an unsafe step unavoidable"
    FEW_WAYS_ON = "proposal predicted to leave too few safe continuations"
    LOW_REWARD = "proposal predicted below R_min"
    UNMODELLED = "proposal unknown to the model"
    LEAST_RISK = "every action is predicted too risky"
    NO_SAFE_ACTION = "every action is predicted unsafe"
    NO_APPLICABLE_ACTION = "no action of the model is applicable"


class Decision(NamedTuple):
    """The record of one decision. Actions are environment actions.

    Attributes:
        action: The executed action.
        executed_by: Whose action it is; FALLBACK if neither planner nor learner had one.
        reason: Why it is executed.
        proposed: The proposed action; -1 if the planner had none.
        proposed_by: Who proposed it.
        rho: ρ at the time of the decision.
        forecast: The planner's forecast for the state.
        admissible: `[E]` whether no veto refuses the action.
    """

    action: int
    executed_by: Actor
    reason: Reason
    proposed: int
    proposed_by: Actor
    rho: float
    forecast: ActionForecast
    admissible: NDArray[np.bool_]

    @property
    def _flags(self) -> int:
        return int(self.forecast.flags[self.action])

    @property
    def predicted_reward(self) -> float:
        """Predicted reward of the executed action, one step; NaN if unknown or not applicable."""
        return float(self.forecast.reward[self.action]) if self._flags & APPLICABLE else np.nan

    @property
    def unsafe(self) -> bool:
        """Whether the file as written flags the executed action."""
        return bool(self._flags & UNSAFE)

    @property
    def risk(self) -> float:
        """Predicted probability, in [0, 1], that the executed action is unsafe.

        1 if it is flagged, NaN if the model does not know it or it is not applicable.
        """
        return risk_of(self._flags) if self._flags & (APPLICABLE | UNSAFE) else np.nan

    @property
    def proposal_unsafe(self) -> bool:
        """Whether the proposed action is flagged, or its risk not accepted."""
        return self.proposed >= 0 and bool(self.forecast.flags[self.proposed] & (UNSAFE | RISKY))

    @property
    def indifferent(self) -> bool:
        """Whether the planner had no reason to prefer one action."""
        return self.forecast.indifferent

    @property
    def depth(self) -> int:
        """Layers of states that the planner saw."""
        return self.forecast.depth

    @property
    def bound(self) -> str:
        """What ended the planner's sight: a name of `Bound` in small letters."""
        return _BOUNDS[self.forecast.bound]

    @property
    def avoidable_unsafe(self) -> bool:
        """Whether the executed action is flagged unsafe, and another possible one is not.

        It breaks the guarantee of `serp.Arbiter`, so it is False for whatever decides within the
        vetoes. An action that the model does not know is possible unless it is refused.
        """
        if not self.unsafe:
            return False
        forecast = self.forecast
        return bool((forecast.unflagged | (self.admissible & (forecast.ground < 0))).any())

    @property
    def vetoed(self) -> bool:
        """Whether a proposal of the learner was refused."""
        return self.proposed_by is not Actor.PLANNER and self.reason is not Reason.ACCEPTED
