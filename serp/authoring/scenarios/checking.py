"""Checks the expectations of scenarios, one by one."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from serp._util.text import listed, plural, readable
from serp.agent.arbiter import Arbiter
from serp.agent.chosen_planner import followed
from serp.agent.decision import Decision, Reason
from serp.agent.explanation import Explanation, compared, explain
from serp.agent.registry import make_planner, refuse_unknown_names
from serp.agent.sentences import between, lesser, lines_of
from serp.agent.veto import VetoPolicy
from serp.authoring.scenarios import syntax as s
from serp.errors import RunError, SerpError
from serp.model.domain import Domain
from serp.model.flags import APPLICABLE
from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.pddl.source import DomainError
from serp.pddl.syntax import REWARD, TERMINAL, UNSAFE
from serp.settings import PlannerSettings, Settings
from serp.tasks.action_map import ActionMap
from serp.tasks.task import Task

if TYPE_CHECKING:
    from serp.agent.agent import Agent


@dataclass(frozen=True)
class Decider:
    """Decides for the planner, within the vetoes; the model predicts the rest.

    Attributes:
        arbiter: Planner and vetoes.
        domain: The domain, whose initial state scenarios begin with.
        settings: Those of the planner.
    """

    arbiter: Arbiter
    domain: Domain
    settings: PlannerSettings

    @property
    def model(self) -> TransitionModel:
        """The model that is planned with."""
        return self.arbiter.model

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
        own = {} if task is None else task.planners
        refuse_unknown_names(settings, own)
        model = domain.model.replace(dt=dt)
        actions = ActionMap(model, len(model.actions))
        planner = make_planner(model, settings.planner, own)
        horizon = settings.planner.depth
        vetoes = VetoPolicy(actions, settings.arbiter, horizon)
        arbiter = Arbiter(planner, actions, settings.arbiter, vetoes=vetoes)
        return cls(arbiter, domain, settings.planner)

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
        steps = followed(
            self.model,
            lambda s: self.executed(self.decide(s)),
            state,
            action,
            self.settings.depth,
        )
        return [executed for executed, _ in steps]

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
    """Return planner and vetoes of a trained agent, with the model that it has learned.

    The learner does not decide: its input may be an observation, which no scenario states.

    Raises:
        RunError: The run is of a domain of another name.
    """
    learned = agent.task.domain
    if learned.name != domain.name:
        raise RunError(
            f"the run is of the domain `{learned.name}`, and the scenarios are of "
            f"`{domain.name}`; give a run of that domain"
        )
    return Decider(agent.guarded, learned, agent.settings.planner)


Recorded = Callable[[s.StepOfRun], Mapping[str, float]]
"""Returns fluent → value of a recorded step."""


@dataclass(frozen=True)
class Failure:
    """An expectation that does not hold: its line, what holds instead, and the causes by action."""

    expected: str
    line: int
    found: str
    causes: Mapping[str, Sequence[str]]


@dataclass(frozen=True)
class Result:
    """A scenario, and its expectations that do not hold."""

    scenario: s.Scenario
    failures: tuple[Failure, ...]

    @property
    def passed(self) -> bool:
        """Whether everything holds that is expected."""
        return not self.failures


def check(scenario: s.Scenario, decider: Decider, recorded: Recorded) -> Result:
    """Check a scenario.

    Raises:
        DomainError: The situation is none of the model, or the recorded step is missing.
    """
    state = situation(scenario, decider, recorded)
    decision = decider.decide(state)
    checker = _Checker(decider, state, decision)
    failures = tuple(
        Failure(expected.place.text, expected.place.line, found, checker.causes_behind(expected))
        for expected in scenario.expectations
        if (found := checker.contradiction(expected))
    )
    return Result(scenario, failures)


def situation(scenario: s.Scenario, decider: Decider, recorded: Recorded) -> Vector:
    """Return the state `[F]` that a scenario begins with."""
    values = decider.start
    if scenario.recorded is not None:
        try:
            of_run = recorded(scenario.recorded)
        except DomainError:
            raise
        except SerpError as error:
            raise DomainError(str(error), scenario.recorded.place) from error
        other = sorted(of_run.keys() ^ values.keys())
        if other:
            raise DomainError(
                f"the run {scenario.recorded.run} has other fluents than "
                f"{decider.domain.source.name}: {listed(other)}",
                scenario.recorded.place,
            )
        values |= of_run
    values |= {given.fluent: given.value for given in scenario.given}
    try:
        return decider.model.state(values)
    except StateError as error:
        raise DomainError(str(error), scenario.place) from error


class _Checker:
    """Checks the expectations of one scenario."""

    def __init__(self, decider: Decider, state: Vector, decision: Decision) -> None:
        self._decider = decider
        self._state = state
        self._decision = decision

    def contradiction(self, expected: s.Expectation) -> str:
        """Return what holds instead of what is expected; empty if that holds."""
        match expected:
            case s.Chooses():
                return self._chooses(expected)
            case s.Refuses():
                return self._refuses(expected)
            case s.Allows(action):
                reason = self._decider.refusal(self._decision, action)
                return "" if reason is None else f"it is refused: {reason}{self._why(action)}"
            case s.Indifferent():
                return "" if self._decision.indifferent else self._choice()
            case s.Rates(what, action, bounds):
                return self._rates(what, action, bounds)
            case s.After():
                return self._after(expected)

    def causes_behind(self, expected: s.Expectation) -> dict[str, list[str]]:
        """Return name → lines on what is behind the actions that an expectation is about."""
        if isinstance(expected, s.After):
            return {}
        actions = {self._decider.executed(self._decision): None}
        if isinstance(expected, s.Chooses):
            actions |= dict.fromkeys(expected.actions[:1])
        elif not isinstance(expected, s.Indifferent):
            actions = {expected.action: None}
        alternatives = self._explained(actions).alternatives
        behind = {
            self._decider.name(action): lines_of(
                alternatives[self._decider.environment_action(action)]
            )
            for action in actions
            if action >= 0
        }
        if len(behind) < 2:
            return behind
        common = set.intersection(*map(set, behind.values()))  # it makes no difference
        return {
            name: [line for line in lines if line not in common] for name, lines in behind.items()
        }

    @property
    def _names(self) -> list[str]:
        actions = self._decider.arbiter.actions
        return [actions.name(number) for number in range(actions.size)]

    def _explained(self, actions: Collection[int]) -> Explanation:
        """Return the account of the decision, with what lies ahead of some ground actions."""
        forecast = self._decision.forecast
        ground = forecast.ground.tolist()
        return explain(
            self._decider.model,
            self._state,
            forecast,
            self._decision.action,
            names=self._names,
            ground=ground,
            paths=[self._decider.path(self._state, g) if g in actions else () for g in ground],
            discount=self._decider.settings.discount,
        )

    def _chooses(self, expected: s.Chooses) -> str:
        chosen = self._decider.executed(self._decision)
        if (chosen in expected.actions) != expected.negated:
            return ""
        rest = "" if expected.negated else self._compared(expected.actions[0])
        return self._choice() + rest

    def _choice(self) -> str:
        decision = self._decision
        chosen = self._decider.executed(decision)
        text = f"{self._decider.name(chosen)} is chosen"
        if decision.indifferent:
            text += ", the first of several that are worth the same"
        return text + ("" if chosen < 0 else f", {self._worth(chosen)}")

    def _compared(self, action: int) -> str:
        """Say why an action is not chosen."""
        reason, chosen = self._decider.refusal(self._decision, action), self._decision.action
        if reason is not None and self._decision.admissible[chosen]:
            return f"; {self._decider.name(action)} is refused: {reason}{self._why(action)}"
        other = self._decider.environment_action(action)
        found = compared(self._decision.forecast, self._names, chosen, other)
        if not found.ahead:
            return f"; {between(found, self._names[chosen]).rstrip('.')}"
        return f"; it comes before {found.name}, {lesser(found)}"

    def _worth(self, action: int) -> str:
        forecast, number = self._decision.forecast, self._decider.environment_action(action)
        remark = self._explained(()).alternatives[number].remark
        return f"worth {readable(float(forecast.value[number]))}" + (remark and f" ({remark})")

    def _why(self, action: int) -> str:
        decision = self._decision._replace(proposed=self._decider.environment_action(action))
        reason = self._decider.refusal(self._decision, action)
        assert reason is not None
        text = self._decider.arbiter.explain(decision._replace(reason=reason), self._state)
        return f" ({text})" if text else ""

    def _refuses(self, expected: s.Refuses) -> str:
        reason = self._decider.refusal(self._decision, expected.action)
        if reason is None:
            return f"it is allowed, {self._worth(expected.action)}"
        if expected.reason and reason is not s.REASONS[expected.reason]:
            return f"it is refused for another reason: {reason}{self._why(expected.action)}"
        return ""

    def _rates(self, what: str, action: int, bounds: s.Bounds) -> str:
        forecast, number = self._decision.forecast, self._decider.environment_action(action)
        if not forecast.flags[number] & APPLICABLE:
            return f"it is not applicable{self._why(action)}"
        found = float(forecast.value[number] if what == "value" else forecast.reward[number])
        return "" if found in bounds else f"it is {readable(found)}, not {bounds}"

    def _after(self, expected: s.After) -> str:
        decider, steps = self._decider, expected.steps
        # None stands for what the planner chooses.
        actions = (None,) * steps if isinstance(steps, int) else steps
        state, reward, unsafe, terminal, made, ended = self._state, 0.0, False, False, 0, ""
        for given in actions:
            action = decider.executed(decider.decide(state)) if given is None else given
            step = None if action < 0 else decider.model.step(state, action)
            if step is None or not step.applicable:
                ended = f"{decider.name(action)} is not applicable"
                break
            state, made, terminal = step.state, made + 1, bool(step.terminal)
            reward += float(step.reward)
            unsafe |= bool(step.unsafe)
            if terminal:
                ended = "the task ends" if made < len(actions) else ""
                break
        after = f"{ended} after {plural(made, 'step')}" if ended else ""
        if expected.fluent in (UNSAFE, TERMINAL):
            value = float(unsafe if expected.fluent == UNSAFE else terminal)
        elif ended:
            return after
        elif expected.fluent == REWARD:
            value = reward
        else:
            names = [fluent.name for fluent in decider.model.fluents]
            value = float(state[names.index(expected.fluent)])
        if value in expected.bounds:
            return ""
        if expected.bounds.text in ("true", "false"):
            shown = f"({expected.fluent}) is {str(bool(value)).lower()}"
            return f"{shown} ({after})" if after else shown
        return f"({expected.fluent}) is {readable(value)}, not {expected.bounds}"
