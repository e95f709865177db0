"""Who decides in a scenario: the planner and the vetoes that a training begins with, or a run's."""

from __future__ import annotations

from typing import TYPE_CHECKING

from serp.control.arbiter import Arbiter
from serp.control.decision import Decision, Reason
from serp.control.own_planners import own_planners
from serp.control.registry import make_planner, refuse_unknown_names
from serp.control.veto import VetoPolicy
from serp.errors import RunError
from serp.model.loading import Domain
from serp.model.transition_model import Vector
from serp.planning.action_map import ActionMap
from serp.settings import PlannerSettings, Settings
from serp.tasks.task import Task

if TYPE_CHECKING:
    from serp.training.agent import Agent


class Decider:
    """Decides for the planner, within the vetoes; what follows is predicted by the model.

    Args:
        arbiter: Planner and vetoes.
        domain: The domain, whose initial state scenarios begin with.
        settings: Those of the planner.

    Attributes:
        arbiter, domain, settings: As given.
        model: The model that is planned with.
    """

    def __init__(self, arbiter: Arbiter, domain: Domain, settings: PlannerSettings) -> None:
        self.arbiter = arbiter
        self.domain = domain
        self.settings = settings
        self.model = arbiter.model

    @classmethod
    def of_domain(
        cls, domain: Domain, settings: Settings, dt: float, task: Task | None = None
    ) -> Decider:
        """Return the decider of a file, before anything is learned.

        No environment is made: of several ground actions that are one action of the environment,
        each decides by itself.

        Raises:
            SettingsError: There is no such planner.
            DomainError: The domain cannot be instantiated.
        """
        own = {} if task is None else own_planners(task.loaded().planners)
        refuse_unknown_names(settings, own)
        model = domain.model.replace(dt=dt)
        actions = ActionMap(model, len(model.actions))
        planner = make_planner(model, settings.planner, own)
        horizon = settings.planner.depth * settings.planner.repeat
        vetoes = VetoPolicy(actions, settings.arbiter, horizon)
        arbiter = Arbiter(planner, actions, settings.arbiter, vetoes=vetoes)
        return cls(arbiter, domain, settings.planner)

    @classmethod
    def of_agent(cls, agent: Agent) -> Decider:
        """Return planner and vetoes of a trained agent, with the model that it has learned.

        The learner is not asked: its input may be an observation, of which a scenario says nothing.
        """
        return cls(agent.guarded, agent.task.domain, agent.settings.planner)

    @property
    def start(self) -> dict[str, float]:
        """Fluent → value in the initial state of the problem; 0 where there is none."""
        initial = self.model.initial_state
        if initial is None:
            return {fluent.name: 0.0 for fluent in self.model.fluents}
        return {fluent.name: float(initial[fluent.index]) for fluent in self.model.fluents}

    def decide(self, state: Vector) -> Decision:
        """Return the planner's decision in a state `[F]`."""
        return self.arbiter.plan(state)

    def path(self, state: Vector, action: int) -> list[int]:
        """Return where a ground action leads by the planner's choices, as far as its depth."""
        path: list[int] = []
        while action >= 0 and len(path) < self.settings.depth:
            step = self.model.step(state, action)
            if not step.applicable:
                break
            path.append(action)
            state = step.state
            action = -1 if step.terminal else self.executed(self.decide(state))
        return path

    def executed(self, decision: Decision) -> int:
        """Return the ground action that a decision executes; -1 if the model does not know it."""
        return int(decision.forecast.ground[decision.action])

    def environment_action(self, action: int) -> int:
        """Return the action of the environment that a ground action is."""
        return self.arbiter.actions.environment_action[action]

    def name(self, action: int) -> str:
        """Return the name of a ground action."""
        return (
            self.model.actions[action].name if action >= 0 else "an action that is not in the file"
        )

    def refusal(self, decision: Decision, action: int) -> Reason | None:
        """Return why a ground action is refused in the state of a decision; None if it is not."""
        number = self.environment_action(action)
        if decision.admissible[number]:
            return None
        return self.arbiter.vetoes.why_refused(decision.forecast, number)


def trained(agent: Agent, domain: Domain) -> Decider:
    """Return the decider of a run for scenarios that were written for a domain of the same name.

    Raises:
        RunError: The run is of another domain.
    """
    found = Decider.of_agent(agent)
    if found.domain.name != domain.name:
        raise RunError(
            f"the run is of the domain `{found.domain.name}`, and the scenarios are of "
            f"`{domain.name}`; give a run of that domain"
        )
    return found
