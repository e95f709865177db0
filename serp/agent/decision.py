"""The record of one decision: the action, its actor, the reason and the predictions."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp.model.flags import APPLICABLE, RISKY, UNSAFE, risk_of
from serp.tasks.action_map import ActionForecast


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
        predicted_reward: Predicted reward of the executed action, one step; NaN if the model does
            not know it or it is not applicable.
        unsafe: Whether the file as written flags the executed action.
        risk: Predicted probability, in [0, 1], that it is unsafe; 1 if it is flagged, NaN if the
            model does not know it or it is not applicable.
        proposal_unsafe: Whether the proposed action is flagged, or its risk not accepted.
        indifferent: Whether the planner had no reason to prefer one action.
        admissible: `[E]` whether no veto refuses the action.
        forecast: The planner's forecast for the state.
    """

    action: int
    executed_by: Actor
    reason: Reason
    proposed: int
    proposed_by: Actor
    rho: float
    predicted_reward: float
    unsafe: bool
    risk: float
    proposal_unsafe: bool
    indifferent: bool
    admissible: NDArray[np.bool_]
    forecast: ActionForecast

    @classmethod
    def of(
        cls,
        forecast: ActionForecast,
        admissible: NDArray[np.bool_],
        *,
        action: int,
        executed_by: Actor,
        reason: Reason,
        proposed: int,
        proposed_by: Actor,
        rho: float,
    ) -> Decision:
        """Return the record of a decision; the rest of it follows from the forecast."""
        flags = int(forecast.flags[action])
        return cls(
            action=action,
            executed_by=executed_by,
            reason=reason,
            proposed=proposed,
            proposed_by=proposed_by,
            rho=rho,
            predicted_reward=float(forecast.reward[action]) if flags & APPLICABLE else np.nan,
            unsafe=bool(flags & UNSAFE),
            risk=risk_of(flags) if flags & (APPLICABLE | UNSAFE) else np.nan,
            proposal_unsafe=proposed >= 0 and bool(forecast.flags[proposed] & (UNSAFE | RISKY)),
            indifferent=forecast.indifferent,
            admissible=admissible,
            forecast=forecast,
        )

    @property
    def depth(self) -> int:
        """Layers of states that the planner saw."""
        return self.forecast.depth

    @property
    def bound(self) -> str:
        """What ended the planner's sight: a name of `Bound` in small letters."""
        return self.forecast.bound.name.lower()

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
