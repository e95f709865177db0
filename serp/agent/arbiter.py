"""The arbiter: executes proposals of planner and learner unless they are refused (Algorithm 1)."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import ClassVar

from serp._util.saved_state import Declared, Reader, part
from serp.agent.decision import Actor, Decision, Reason
from serp.agent.explanation import Alternative, explain
from serp.agent.protocols import Planner, Proposer
from serp.agent.sentences import why_refused
from serp.agent.strategy import Mixture, Situation, Strategy
from serp.agent.veto import VetoPolicy
from serp.learning.dqn import Proposal
from serp.model.flags import RISKY, UNDEFINED, UNSAFE, risk_of
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.forecast import Bound
from serp.settings import ArbiterSettings, Settings
from serp.tasks.action_map import ActionForecast, ActionMap


class Arbiter(Declared):
    """Executes what a strategy proposes, except for refused actions.

    Guarantee, under every strategy and whatever was learned: no action that the file as written
    flags unsafe is executed while an action that is not flagged is available. (Applicable actions
    are available, and so are actions that the model does not know unless they are vetoed.) Of the
    actions that are not flagged, none whose predicted risk is larger than accepted is executed
    while one whose risk is accepted is applicable. An action whose result is undefined does not
    count as safe: it is executed only if all others are flagged or certain to do damage. The
    guarantee needs a `VetoPolicy` that refuses.

    Args:
        planner: Makes the forecasts, usually a `Lookahead`.
        actions: The map between ground and environment actions.
        settings: See `ArbiterSettings`.
        strategy: Makes the proposals; by default Algorithm 1 with these settings.
        vetoes: Refuses actions; by default a `VetoPolicy` with these settings.
        exploration_bonus: Returns a forecast whose choice has been tried less often, to be used in
            training; by default the same forecast.
    """

    STATE: ClassVar[Mapping[str, Reader]] = {"strategy": part, "vetoes": part}

    def __init__(
        self,
        planner: Planner,
        actions: ActionMap,
        settings: ArbiterSettings | None = None,
        strategy: Strategy | None = None,
        *,
        vetoes: VetoPolicy | None = None,
        exploration_bonus: Callable[[ActionForecast], ActionForecast] = lambda forecast: forecast,
    ) -> None:
        self.planner = planner
        self.actions = actions
        self.settings = settings or ArbiterSettings()
        self.strategy = strategy or Mixture(Settings(arbiter=self.settings))
        self.vetoes = vetoes or VetoPolicy(actions, self.settings)
        self._exploration_bonus = exploration_bonus

    @property
    def model(self) -> TransitionModel:
        """The transition model."""
        return self.actions.model

    def forecast(self, state: Vector) -> ActionForecast:
        """Return the planner's forecast for a state `[F]`, by environment action."""
        return self.actions.project(self.planner.forecast(state))

    def begin_episode(self) -> None:
        """Say that an episode begins, perhaps in another world."""
        if hasattr(self.planner, "begin_episode"):
            self.planner.begin_episode()

    def prefetch(self, states: Sequence[Vector]) -> AbstractContextManager[None]:
        """Have the forecasts for several states at hand in the body, if the planner can."""
        if len(states) > 1 and hasattr(self.planner, "prefetch"):
            context: AbstractContextManager[None] = self.planner.prefetch(states)
            return context
        return nullcontext()

    def decide(self, state: Vector, learner: Proposer) -> Decision:
        """Decide on the action in a monitored state `[F]`, as in training."""
        situation = self._situation(state, plan=self.strategy.needs_plan())
        proposal = self.strategy.propose(situation, learner)
        if proposal is None:
            forecast = situation.forecast
            preferred, planner = self._exploration_bonus(forecast), Actor.PLANNER
            action = preferred.choice
            if preferred is not forecast and action >= 0 and forecast.safe[action]:
                reason, rho = Reason.LITTLE_TRIED, self.strategy.rho
                return Decision(action, planner, reason, action, planner, rho, *situation.record)
        return self._follow(situation, proposal)

    def decide_greedily(self, state: Vector, learner: Proposer) -> Decision:
        """Decide as the trained policy does, without exploration or random draws."""
        situation = self._situation(state, plan=self.strategy.needs_plan(greedily=True))
        return self._follow(situation, self.strategy.propose_greedily(situation, learner))

    def judge_proposal(self, state: Vector, proposal: Proposal) -> Decision:
        """Decide on a given proposal: execute it unless it is refused."""
        situation = self._situation(state, plan=self.strategy.needs_plan())
        return self._follow(situation, proposal)

    def exchange(self, decision: Decision, state: Vector, proposal: Proposal) -> Decision:
        """Return the decision in the same state `[F]` for another proposal.

        A new forecast is made only where nothing was planned and the proposal is refused.
        """
        known, admissible = decision.forecast, decision.admissible
        later = self._later(known, state)
        return self._follow(Situation(state, known, admissible, later), proposal)

    def execute(self, state: Vector, proposal: Proposal) -> Decision:
        """Execute a proposal without a veto. The guarantee does not hold."""
        return self._accept(self._situation(state), proposal)

    def plan(self, state: Vector) -> Decision:
        """Decide by the planner, whatever ρ is."""
        return self._follow(self._situation(state, plan=True), None)

    # Who acts ----------------------------------------------------------------------------------

    def _situation(self, state: Vector, *, plan: bool = False) -> Situation:
        """Return the situation in a state: planned, or else what is safe, if the planner can."""
        checked = None
        if hasattr(self.planner, "farther"):
            self.planner.farther = self.vetoes.looks_farther
        if not plan and hasattr(self.planner, "check_safety"):
            checked = self.planner.check_safety(state)
        known = self.forecast(state) if checked is None else self.actions.project(checked)
        return Situation(state, known, self.vetoes.admissible(known), self._later(known, state))

    def _later(self, known: ActionForecast, state: Vector) -> Callable[[], ActionForecast] | None:
        """Return what plans in a state of which only the safety of actions is known; else None."""
        return functools.partial(self.forecast, state) if known.bound is Bound.SAFETY else None

    def _follow(self, situation: Situation, proposal: Proposal | None) -> Decision:
        if proposal is None:
            planned = situation.forecast.choice
            return self._planner_acts(situation, planned, Actor.PLANNER, Reason.PLANNER_TURN)
        action = int(proposal.action)
        if situation.admissible[action]:
            return self._accept(situation, proposal)
        refusal = self.vetoes.reason_against(situation.forecast, action)
        return self._planner_acts(situation, action, _proposer(proposal), refusal)

    def _accept(self, situation: Situation, proposal: Proposal) -> Decision:
        actor, action, rho = _proposer(proposal), int(proposal.action), self.strategy.rho
        return Decision(action, actor, Reason.ACCEPTED, action, actor, rho, *situation.record)

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
            instead = self._fallback(forecast, proposed, otherwise=action)
            if instead != action:
                action, executed_by = instead, Actor.FALLBACK
        return Decision(
            action, executed_by, reason, proposed, proposed_by, self.strategy.rho, *situation.record
        )

    def _fallback(self, forecast: ActionForecast, proposed: int, otherwise: int) -> int:
        """Return the action to execute when the planner's choice is certain to do damage, or -1.

        In order of preference: actions that the model does not know, actions with an undefined
        result, the planner's choice (`otherwise`), actions that are not applicable. Within a kind,
        the proposed action is preferred.
        """
        unpredicted = (forecast.flags & (UNDEFINED | UNSAFE)) == UNDEFINED
        kinds = [self.vetoes.allowed_unknown, unpredicted]
        if otherwise < 0:
            kinds.append((forecast.flags == 0) & self.actions.modelled)
        for kind in kinds:
            if kind.any():
                return proposed if proposed >= 0 and kind[proposed] else int(kind.argmax())
        return otherwise if otherwise >= 0 else max(proposed, 0)

    # Explaining --------------------------------------------------------------------------------

    def explain(self, decision: Decision, state: Vector) -> str:
        """Return why a proposal was refused, in terms of the domain file; empty if it was not."""
        if decision.reason in (Reason.PLANNER_TURN, Reason.LITTLE_TRIED, Reason.ACCEPTED):
            return ""
        shown = decision.proposed if decision.proposed >= 0 else decision.action
        of = self.alternatives(decision.forecast, state)[shown]
        why = why_refused(decision.reason, of.causes, of.reward, of.safe_steps)
        return f"{of.name}: {decision.reason}{why}"

    def alternatives(self, forecast: ActionForecast, state: Vector) -> tuple[Alternative, ...]:
        """Return what is predicted for each action of the environment, in terms of the file."""
        names = [self.actions.name(number) for number in range(self.actions.size)]
        ground = forecast.ground.tolist()
        return explain(self.model, state, forecast, None, names=names, ground=ground).alternatives


def _proposer(proposal: Proposal) -> Actor:
    return Actor.EXPLORATION if proposal.exploratory else Actor.LEARNER
