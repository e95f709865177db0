"""Checks the scenarios of a file, one expectation after the other, and writes one more."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from serp._util.did_you_mean import listed
from serp._util.text import plural, readable
from serp.agent.agent import Agent
from serp.agent.arbiter import Arbiter
from serp.agent.chosen_planner import ChosenPlanner
from serp.agent.decision import Decision, Reason
from serp.agent.explanation import Alternative, compared
from serp.agent.protocols import undisturbed
from serp.agent.registry import make_planner, refuse_unknown_names
from serp.agent.sentences import between, lesser, lines_of
from serp.agent.veto import VetoPolicy
from serp.authoring.scenarios import syntax as s
from serp.authoring.scenarios.reading import observed_in, read_scenarios
from serp.errors import RunError, SerpError
from serp.model.domain import Domain
from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.pddl.source import DomainError, Source, newline_of
from serp.pddl.syntax import REWARD, TERMINAL, UNSAFE
from serp.planning.replanner import Plan
from serp.runs.recording import open_recording
from serp.settings import PlannerSettings, Settings
from serp.tasks.action_map import ActionMap
from serp.tasks.task import Task


@dataclass(frozen=True)
class Decider:
    """Decides for the planner, within the vetoes; the model predicts the rest.

    Scenarios begin with the initial state of `domain`; `settings` are those of the planner.
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
        cls, source: Source, domain: Domain, settings: Settings, dt: float, task: Task | None = None
    ) -> Decider:
        """Return the decider of a domain, before anything is learned, for a file of scenarios.

        No environment is made: of several ground actions that are one action of the environment,
        each decides by itself. What the scenarios give a value to is observed.
        """
        refuse_unknown_names(settings, task)
        domain = observed_in(source, domain)
        model = domain.model.replace(dt=dt)
        actions = ActionMap(model, len(model.actions))
        planner = make_planner(model, settings.planner, None if task is None else task.planners)
        vetoes = VetoPolicy(actions, settings.arbiter, settings.planner.depth)
        arbiter = Arbiter(planner, actions, settings.arbiter, vetoes=vetoes)
        return cls(arbiter, domain, settings.planner)

    @classmethod
    def of_agent(cls, agent: Agent, domain: Domain) -> Decider:
        """Return planner and vetoes of a trained agent, with the model that it has learned.

        The learner does not decide: its input may be an observation, which no scenario states.
        """
        learned = agent.task.domain
        if learned.name != domain.name:
            raise RunError(
                f"the run belongs to the domain `{learned.name}`, but the scenarios belong to "
                f"`{domain.name}`; give a run of `{domain.name}`"
            )
        return cls(agent.guarded, learned, agent.settings.planner)

    @property
    def start(self) -> dict[str, float]:
        """Fluent → value in the initial state of the problem; 0 where there is none."""
        initial = self.model.initial_state
        return {
            fluent.name: 0.0 if initial is None else float(initial[fluent.index])
            for fluent in self.model.fluents
        }

    def situation(self, scenario: s.Scenario) -> Vector:
        """Return the state `[F]` that a scenario begins with."""
        values = self.start
        if scenario.recorded is not None:
            try:
                of_run = recorded_values(scenario.recorded)
            except SerpError as error:
                raise DomainError(str(error), scenario.recorded.place) from error
            if other := sorted(of_run.keys() ^ values.keys()):
                raise DomainError(
                    f"the run {scenario.recorded.run} has other fluents than "
                    f"{self.domain.source.name}: {listed(other)}",
                    scenario.recorded.place,
                )
            values |= of_run
        values |= scenario.given
        try:
            return self.model.state(values)
        except StateError as error:
            raise DomainError(str(error), scenario.place) from error

    def executed(self, decision: Decision) -> int:
        """Return the ground action that a decision executes; -1 if the model does not know it."""
        return int(decision.forecast.ground[decision.action])

    def chosen(self, state: Vector) -> int:
        """Return the ground action that is executed in a state `[F]`; -1 for none."""
        return self.executed(self.arbiter.plan(state))

    def name(self, action: int) -> str:
        """Return the name of a ground action."""
        known = self.model.actions
        return known[action].name if action >= 0 else "an action that is not in the file"

    def refusal(self, decision: Decision, action: int) -> Reason | None:
        """Return why a ground action is refused in the state of a decision; None if it is not."""
        number = self.arbiter.actions.environment_action[action]
        if decision.admissible[number]:
            return None
        return self.arbiter.vetoes.reason_against(decision.forecast, number)


def recorded_values(of: s.StepOfRun) -> dict[str, float]:
    """Return fluent → value of a step that a scenario names."""
    recording = open_recording(Path(of.run))
    step = of.step if of.episode is None else recording.find(of.episode, of.step)
    return dict(zip(recording.layout.fluents, recording.step(step).state.tolist(), strict=True))


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


def run_scenarios(source: Source, decider: Decider, words: str = "") -> Iterator[Result]:
    """Check the scenarios of a file one by one; with `words`, those whose title has them.

    What the planner keeps of one is forgotten before the next, so that none depends on others.

    Raises:
        DomainError: The file is wrong.
    """
    for scenario in read_scenarios(source, decider.domain, decider.model):
        if words.lower() in scenario.title.lower():
            with undisturbed(decider.arbiter.planner):
                result = _checked(scenario, decider)
            yield result


def _checked(scenario: s.Scenario, decider: Decider) -> Result:
    checker = _Checker(decider, decider.situation(scenario))
    failures = tuple(
        Failure(expected.place.text, expected.place.line, found, checker.causes_behind(expected))
        for expected in scenario.expectations
        if (found := checker.contradiction(expected))
    )
    return Result(scenario, failures)


class _Checker:
    """Checks the expectations of one scenario."""

    def __init__(self, decider: Decider, state: Vector) -> None:
        self._decider, self._state = decider, state
        self._decision = decider.arbiter.plan(state)
        self._chosen = decider.executed(self._decision)

    @functools.cached_property
    def _plan(self) -> Plan:
        return self._planner.plan(self._state)

    @functools.cached_property
    def _planner(self) -> ChosenPlanner:
        of = self._decider
        return ChosenPlanner(of.arbiter.planner, of.model, of.settings, "", seconds=5.0)

    @functools.cached_property
    def _alternatives(self) -> Sequence[Alternative]:
        """The account of all ground actions."""
        return self._planner.explain(self._state, self._plan).alternatives

    def contradiction(self, expected: s.Expectation) -> str:
        """Return what holds instead of what is expected; empty if that holds."""
        match expected:
            case s.Chooses(actions, negated):
                if (self._chosen in actions) != negated:
                    return ""
                return self._choice() + ("" if negated else self._why_not(actions[0]))
            case s.Refuses(action, wanted, negated):
                reason = self._decider.refusal(self._decision, action)
                if reason is None:
                    return "" if negated else f"it is allowed, {self._worth(action)}"
                if not negated and (not wanted or reason is s.REASONS[wanted]):
                    return ""
                other = "" if negated else " for another reason"
                return f"it is refused{other}: {reason}{self._remark(action)}"
            case s.Indifferent():
                return "" if self._decision.indifferent else self._choice()
            case s.Rates(what, action, bounds):
                forecast = self._plan.forecast
                if not forecast.applicable[action]:
                    return f"it is not applicable{self._remark(action)}"
                found = float((forecast.value if what == "value" else forecast.reward)[action])
                return "" if found in bounds else f"it is {readable(found)}, not {bounds}"
            case s.After():
                return self._after(expected)

    def causes_behind(self, expected: s.Expectation) -> dict[str, list[str]]:
        """Return name → lines on what is behind the actions that an expectation is about."""
        if isinstance(expected, s.After):
            return {}
        actions = {self._chosen: None}
        if isinstance(expected, s.Chooses):
            actions |= dict.fromkeys(expected.actions[:1])
        elif not isinstance(expected, s.Indifferent):
            actions = {expected.action: None}
        behind = {
            self._decider.name(action): lines_of(self._alternatives[action])
            for action in actions
            if action >= 0
        }
        common = set[str]()  # what makes no difference
        if len(behind) > 1:
            common = set.intersection(*map(set, behind.values()))
        return {
            name: [line for line in lines if line not in common] for name, lines in behind.items()
        }

    def _choice(self) -> str:
        text = f"{self._decider.name(self._chosen)} is chosen"
        if self._decision.indifferent:
            text += ", the first of several that are worth the same"
        return text + ("" if self._chosen < 0 else f", {self._worth(self._chosen)}")

    def _why_not(self, action: int) -> str:
        """Say why an action is not chosen."""
        reason, name = self._decider.refusal(self._decision, action), self._decider.name
        if reason is not None and self._decision.admissible[self._decision.action]:
            return f"; {name(action)} is refused: {reason}{self._remark(action)}"
        if self._chosen < 0:
            return ""
        names = [ground.name for ground in self._decider.model.actions]
        other = compared(self._plan.forecast, names, self._chosen, action)
        if not other.ahead:
            return f"; {between(other, name(self._chosen)).rstrip('.')}"
        return f"; it comes before {other.name}, {lesser(other)}"

    def _worth(self, action: int) -> str:
        value = self._alternatives[action].best_return
        return f"worth {readable(value)}{self._remark(action)}"

    def _remark(self, action: int) -> str:
        remark = self._alternatives[action].remark
        return f" ({remark})" if remark else ""

    def _after(self, expected: s.After) -> str:
        decider, steps = self._decider, expected.steps
        # None stands for what the planner chooses.
        actions = (None,) * steps if isinstance(steps, int) else steps
        state, reward, unsafe, terminal, made, ended = self._state, 0.0, False, False, 0, ""
        for given in actions:
            action = decider.chosen(state) if given is None else given
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
        flags = {UNSAFE: unsafe, TERMINAL: terminal}
        if ended and expected.fluent not in flags:
            return after
        values = {REWARD: reward, **flags, **decider.model.values(state)}
        value = values[expected.fluent]
        if float(value) in expected.bounds:
            return ""
        if expected.bounds.text in ("true", "false"):
            shown = f"({expected.fluent}) is {readable(bool(value))}"
            return f"{shown} ({after})" if after else shown
        return f"({expected.fluent}) is {readable(float(value))}, not {expected.bounds}"


# Files -------------------------------------------------------------------------------------------


def scenarios_beside(domain: Domain) -> Path:
    """Return the scenario file of a domain: `<name>.scenarios` beside `<name>.pddl`."""
    return Path(domain.source.name).with_suffix(s.SUFFIX)


def read_beside(domain: Domain) -> Source:
    """Read the scenario file of a domain.

    Raises:
        SerpError: There is none.
    """
    file = scenarios_beside(domain)
    if file.is_file():
        return Source.read(file)
    model = domain.model
    numeric = next((fluent.name for fluent in model.fluents if fluent.numeric), None)
    given = "" if numeric is None else f"    ({numeric}) = 0\n"
    action = model.actions[0].name if model.actions else "an-action"
    raise SerpError(
        f"{domain.source.name} has no scenarios: there is no {file}\n"
        "  write one, for example:\n\n"
        f"  scenario what the planner does at first\n{given}    chooses {action}\n"
    )


def add_situation(
    source: Source, decider: Decider, title: str, values: Mapping[str, float], remark: str
) -> str:
    """Return the text of a file with a scenario of what holds where fluents have `values`.

    It replaces a scenario of the same title. `remark` is a comment on where the situation comes
    from.
    """
    newline = newline_of(source.text)
    lines = [f"scenario {title}", f"  ; {remark}", *_situation(values, decider)]
    written = newline.join([*lines, *_expected(values, decider, title)])
    for scenario in read_scenarios(source, decider.domain, decider.model):
        if scenario.title.lower() == title.lower():
            begin = source.line_starts[scenario.place.line - 1]
            last = scenario.expectations[-1].place.line
            end = source.line_starts[last - 1] + len(source.line_text(last))
            return source.text[:begin] + written + source.text[end:]
    before = source.text.rstrip("\r\n") + 2 * newline if source.text else ""
    return before + written + newline


def _situation(values: Mapping[str, float], decider: Decider) -> Iterator[str]:
    start = decider.start
    for fluent in decider.model.fluents:
        value = values[fluent.name]
        if value == start[fluent.name]:
            continue
        if fluent.numeric:
            yield f"  ({fluent.name}) = {value!r}"
        else:
            yield f"  ({fluent.name})" if value else f"  not ({fluent.name})"


def _expected(values: Mapping[str, float], decider: Decider, title: str) -> list[str]:
    decision = decider.arbiter.plan(decider.model.state(values))
    # Other reasons of refusals belong to most actions of many domains.
    dangers = {s.REASONS[word]: word for word in ("unsafe", "unsafe ahead", "too risky")}
    expected = []
    if (chosen := decider.executed(decision)) >= 0:
        expected.append(f"  chooses {decider.name(chosen)}")
    for action in range(len(decider.model.actions)):
        reason = decider.refusal(decision, action)
        if reason in dangers:
            expected.append(f"  refuses {decider.name(action)} because {dangers[reason]}")
    if not expected:
        raise SerpError(f"{title}: the planner has no action here, and no action is unsafe")
    return expected
