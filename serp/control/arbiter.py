"""Who acts: planner or learner, and what is refused (paper, Algorithm 1).

Guarantee: no action that the file as written flags unsafe is executed while one that it does not is
available, whoever proposed it and whatever was learned. (Available are the applicable actions, and
those that the model does not know unless they are vetoed.) Of those that are not flagged, none
whose predicted risk is larger than accepted is executed while one whose risk is accepted is
applicable. An action whose result is undefined does not pass for safe: it is executed only where
all others are flagged or certain to do damage. Every decision passes `Arbiter.decide` and leaves
one `Decision`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import StrEnum
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from serp._util.numbers import best_of
from serp._util.saved_state import Saved
from serp.control.lookahead_reliability import LookaheadReliability
from serp.control.model_confidence import ModelConfidence
from serp.control.strategies.mixture import mixture_of
from serp.control.strategies.strategy import Learner, Proposed, Situation, Strategy
from serp.model.explanation import unsafe_ahead, why_not_applicable, why_unsafe
from serp.model.flags import APPLICABLE, RISKY, UNDEFINED, UNSAFE, risk_of
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.action_map import ActionForecast, ActionMap
from serp.planning.forecast import SAFE, Forecast
from serp.settings.sections import ArbiterSettings


class Actor(StrEnum):
    """Who proposed or executed an action."""

    PLANNER = "planner"
    LEARNER = "learner"
    EXPLORATION = "exploration"
    FALLBACK = "fallback"


class Reason(StrEnum):
    """Why the executed action was executed."""

    PLANNER_TURN = "planner's turn"
    CURIOUS = "planner tries what it hardly knows"
    ACCEPTED = "proposal accepted"
    NOT_APPLICABLE = "proposal not applicable"
    UNDEFINED = "proposal has no defined result"
    UNSAFE = "proposal predicted unsafe"
    TOO_RISKY = "proposal predicted too risky"
    UNSAFE_AHEAD = "proposal leads to where all is predicted unsafe"
    LOW_REWARD = "proposal predicted below R_min"
    UNMODELLED = "proposal unknown to the model"
    LEAST_RISK = "every action is predicted too risky"
    NO_SAFE_ACTION = "every action is predicted unsafe"
    NO_APPLICABLE_ACTION = "no action of the model is applicable"


class Forecaster(Protocol):
    """What the arbiter needs of a planner; `Lookahead` is one."""

    def forecast(self, state: Vector) -> Forecast:
        """Return the planner's view of a state."""


class Decision(NamedTuple):
    """The record of one decision. Actions are environment actions.

    Attributes:
        action: What is executed.
        executed_by: Whose action it is; FALLBACK where neither planner nor learner had one.
        reason: Why.
        proposed: What was proposed; -1 where the planner had no action to propose.
        proposed_by: By whom.
        rho: ρ at that moment.
        predicted_reward: Predicted reward of the executed action, one step; NaN where the model
            does not know it or it is not applicable.
        unsafe: Whether the file as written flags the executed action.
        risk: Predicted probability, in [0, 1], that it is unsafe; 1 where it is flagged, NaN where
            the model does not know it or it is not applicable.
        proposal_unsafe: Whether the proposed action is flagged, or its risk not accepted.
        admissible: `[E]` actions that no veto refuses; all False where every one is refused.
        forecast: The planner's view of the state.
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
    admissible: NDArray[np.bool_]
    forecast: ActionForecast

    @property
    def vetoed(self) -> bool:
        """Whether a proposal of the learner was refused."""
        return self.proposed_by is not Actor.PLANNER and self.reason is not Reason.ACCEPTED


Preference = Callable[[Forecast], Forecast]
"""Gives a forecast another choice."""


def _no_preference(forecast: Forecast) -> Forecast:
    return forecast


class Arbiter:
    """Lets a strategy mix planner and learner and keeps refused actions from being executed.

    Args:
        planner: Where forecasts come from, usually a `Lookahead`.
        actions: The map between ground and environment actions.
        settings: See `ArbiterSettings`.
        strategy: Who proposes; by default Algorithm 1 as the settings have it.
        horizon: Control periods that the planner looks ahead.
        curiosity: What the planner does for the sake of learning, in training; by default nothing.
        trust: Says how far the model can be trusted; by default nothing is known of it.

    Attributes:
        promises: How often the planner's word was broken.
    """

    def __init__(
        self,
        planner: Forecaster,
        actions: ActionMap,
        settings: ArbiterSettings | None = None,
        strategy: Strategy | None = None,
        horizon: int = 1,
        curiosity: Preference = _no_preference,
        trust: Callable[[], ModelConfidence] = lambda: ModelConfidence.OPEN,
    ) -> None:
        self.planner = planner
        self.actions = actions
        self.settings = settings or ArbiterSettings()
        self.strategy = strategy or mixture_of(self.settings, seed=0)
        self.promises = LookaheadReliability(horizon, self.settings.max_lookahead_failures)
        self._curiosity = curiosity
        self._trust = trust
        self._unmodelled_allowed = (
            ~actions.modelled
            if self.settings.unmodelled == "allow"
            else np.zeros(actions.size, dtype=np.bool_)
        )

    @property
    def available(self) -> NDArray[np.bool_]:
        """`[E]` the actions that the model does not know and that may be executed all the same."""
        return self._unmodelled_allowed

    @property
    def model(self) -> TransitionModel:
        """The transition model."""
        return self.actions.model

    @property
    def rho(self) -> float:
        """The probability that the learner is asked next."""
        return self.strategy.rho

    def forecast(self, state: Vector) -> ActionForecast:
        """Return the planner's view of a state `[F]` in terms of environment actions."""
        return self.actions.project(self.planner.forecast(state))

    def admissible(self, forecast: ActionForecast) -> NDArray[np.bool_]:
        """Return `[E]` which actions no veto refuses."""
        allowed = forecast.safe
        if self.settings.r_min is not None:
            allowed &= forecast.reward >= self.settings.r_min
        if self.settings.veto_horizon == "lookahead" and self.promises.believed:
            # Against the best that the model knows: where all is lost, nothing is refused for it.
            known = forecast.safe_steps[self.actions.modelled]
            if known.size and known.max() == SAFE:
                allowed &= forecast.safe_steps == SAFE
        return allowed | self._unmodelled_allowed

    def decide(self, state: Vector, learner: Learner) -> Decision:
        """Decide what to do in a state.

        Args:
            state: Monitored state `[F]`.
            learner: The learner before this state; the strategy asks it where it is its turn.
        """
        planned = self.planner.forecast(state)
        situation = self._situation_of(self.actions.project(planned))
        proposal = self.strategy.propose(situation, learner)
        curious = planned if proposal is not None else self._curiosity(planned)
        if curious is not planned:
            action = self.actions.project(curious).choice
            if action >= 0 and situation.forecast.safe[action]:
                return self._record(
                    situation, action, Actor.PLANNER, Reason.CURIOUS, action, Actor.PLANNER
                )
        return self._follow(situation, proposal)

    def decide_greedily(self, state: Vector, learner: Learner) -> Decision:
        """Decide as the trained policy does, without exploration or draw."""
        situation = self._situation(state)
        return self._follow(situation, self.strategy.propose_greedily(situation, learner))

    def decide_in_turns(self, state: Vector, learner: Learner, strategy: Strategy) -> Decision:
        """Decide as in training, with the turns of a strategy, without curiosity."""
        situation = self._situation(state)
        return self._follow(situation, strategy.propose(situation, learner))

    def judge_proposal(self, state: Vector, proposal: Proposed) -> Decision:
        """Decide on a proposal whoever's turn it is: it is executed, or refused."""
        return self._consider(self._situation(state), proposal)

    def let(self, state: Vector, learner: Learner) -> Decision:
        """Record what the learner does alone, whatever the model says of it.

        There is no veto, and the guarantee does not hold.
        """
        situation = self._situation(state)
        return self._accept(situation, self.strategy.propose_alone(situation, learner))

    def plan(self, state: Vector) -> Decision:
        """Let the planner act, whatever ρ is."""
        return self._planners_turn(self._situation(state))

    def observe(self, decision: Decision, *, unsafe: bool, last: bool) -> None:
        """Take note of what came of a decision in training.

        Args:
            decision: It.
            unsafe: Whether something unsafe was observed.
            last: Whether the episode ended with it.
        """
        known = bool(self.actions.modelled[decision.action])
        promised = known and decision.forecast.safe_steps[decision.action] == SAFE
        self.promises.observe(promised if known else None, unsafe, last)

    # Who acts ----------------------------------------------------------------------------------

    def _situation(self, state: Vector) -> Situation:
        return self._situation_of(self.forecast(state))

    def _situation_of(self, forecast: ActionForecast) -> Situation:
        admissible = self.admissible(forecast)
        explorable = self._explorable(forecast, admissible)
        return Situation(forecast, admissible, explorable, self._trust())

    def _follow(self, situation: Situation, proposal: Proposed | None) -> Decision:
        if proposal is None:
            return self._planners_turn(situation)
        return self._consider(situation, proposal)

    def _planners_turn(self, situation: Situation) -> Decision:
        action = situation.forecast.choice
        return self._planner_acts(situation, action, Actor.PLANNER, Reason.PLANNER_TURN)

    def _consider(self, situation: Situation, proposal: Proposed) -> Decision:
        admissible = situation.admissible
        actor, action = _proposer(proposal), int(proposal.action)
        if admissible[action]:
            return self._accept(situation, proposal)
        refusal = self._refusal(situation.forecast, action)
        if self.settings.after_veto == "learner" and proposal.q is not None and admissible.any():
            second = best_of(proposal.q, admissible)
            return self._record(situation, second, actor, refusal, action, actor)
        return self._planner_acts(situation, action, actor, refusal)

    def _accept(self, situation: Situation, proposal: Proposed) -> Decision:
        actor, action = _proposer(proposal), int(proposal.action)
        return self._record(situation, action, actor, Reason.ACCEPTED, action, actor)

    def _explorable(
        self, forecast: ActionForecast, admissible: NDArray[np.bool_]
    ) -> NDArray[np.bool_] | None:
        slack = self.settings.exploration_slack
        if slack is None:
            return None
        if slack == np.inf or not admissible.any():
            return admissible
        good = forecast.value >= forecast.value[admissible].max() - slack
        explorable: NDArray[np.bool_] = admissible & (good | ~self.actions.modelled)
        return explorable

    def _refusal(self, forecast: ActionForecast, action: int) -> Reason:
        if not self.actions.modelled[action]:
            return Reason.UNMODELLED
        flags = int(forecast.flags[action])
        if flags & UNSAFE:
            return Reason.UNSAFE
        if flags & RISKY:
            return Reason.TOO_RISKY
        if flags & UNDEFINED:
            return Reason.UNDEFINED
        if not flags & APPLICABLE:
            return Reason.NOT_APPLICABLE
        r_min = self.settings.r_min
        if r_min is not None and forecast.reward[action] < r_min:
            return Reason.LOW_REWARD
        return Reason.UNSAFE_AHEAD

    def _planner_acts(
        self, situation: Situation, proposed: int, proposed_by: Actor, reason: Reason
    ) -> Decision:
        forecast = situation.forecast
        action, executed_by = forecast.choice, Actor.PLANNER
        flags = int(forecast.flags[action]) if action >= 0 else 0
        if flags & UNSAFE:
            reason = Reason.NO_SAFE_ACTION
        elif flags & RISKY:
            reason = Reason.LEAST_RISK
        elif action < 0:
            reason = Reason.NO_APPLICABLE_ACTION
        if action < 0 or risk_of(flags) == 1.0:
            instead = self._least_evil(forecast, proposed, otherwise=action)
            if instead != action:
                action, executed_by = instead, Actor.FALLBACK
        return self._record(situation, action, executed_by, reason, proposed, proposed_by)

    def _least_evil(self, forecast: ActionForecast, proposed: int, otherwise: int) -> int:
        """Return what is done instead of certain damage; `otherwise` is the planner's, or -1.

        What the model does not know comes before what it cannot predict, and that before what does
        damage. What cannot be done comes last; of equals, what was proposed.
        """
        unpredicted = (forecast.flags & (UNDEFINED | UNSAFE)) == UNDEFINED
        kinds = [self._unmodelled_allowed, unpredicted]
        if otherwise < 0:
            kinds.append((forecast.flags == 0) & self.actions.modelled)
        for kind in kinds:
            if kind.any():
                return proposed if proposed >= 0 and kind[proposed] else int(kind.argmax())
        return otherwise if otherwise >= 0 else max(proposed, 0)

    def _record(
        self,
        situation: Situation,
        action: int,
        executed_by: Actor,
        reason: Reason,
        proposed: int,
        proposed_by: Actor,
    ) -> Decision:
        forecast, admissible = situation.forecast, situation.admissible
        flags = int(forecast.flags[action])
        return Decision(
            action=action,
            executed_by=executed_by,
            reason=reason,
            proposed=proposed,
            proposed_by=proposed_by,
            rho=self.rho,
            predicted_reward=float(forecast.reward[action]) if flags & APPLICABLE else np.nan,
            unsafe=bool(flags & UNSAFE),
            risk=risk_of(flags) if flags & (APPLICABLE | UNSAFE) else np.nan,
            proposal_unsafe=proposed >= 0 and bool(forecast.flags[proposed] & (UNSAFE | RISKY)),
            admissible=admissible,
            forecast=forecast,
        )

    # Explaining --------------------------------------------------------------------------------

    def explain(self, decision: Decision, state: Vector) -> str:
        """Say in the words of the domain file what is wrong with what was proposed.

        Empty where the proposal, the planner's or the learner's, was fine and was executed.
        """
        if decision.reason in (Reason.PLANNER_TURN, Reason.CURIOUS, Reason.ACCEPTED):
            return ""
        shown = decision.proposed if decision.proposed >= 0 else decision.action
        ground = int(decision.forecast.ground[shown])
        if ground < 0:
            return f"{self.actions.name(shown)}: the domain does not mention it"
        flags = int(decision.forecast.flags[shown])
        if not flags & APPLICABLE:
            return why_not_applicable(self.model, state, ground)
        if flags & (UNSAFE | RISKY):
            return why_unsafe(self.model, state, ground)
        name = self.model.actions[ground].name
        if decision.reason is Reason.LOW_REWARD:
            return (
                f"{name}: predicted reward {decision.forecast.reward[shown]:.4g} is below "
                f"R_min {self.settings.r_min:g}"
            )
        steps = int(decision.forecast.safe_steps[shown])
        return f"{name}: {unsafe_ahead(steps)}"

    # State -------------------------------------------------------------------------------------

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        return {}, {
            "strategy": self.strategy.state_dict(),
            "promises": self.promises.state_dict(),
        }

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It is damaged.
        """
        saved = Saved("arbiter", arrays, meta)
        self.strategy.load_state_dict(saved.part("strategy")[1])
        self.promises.load_state_dict(saved.part("promises")[1])


def _proposer(proposal: Proposed) -> Actor:
    return Actor.EXPLORATION if proposal.exploratory else Actor.LEARNER
