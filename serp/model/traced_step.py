"""The step of a ground model in readable form: what takes part in it, and why it has no result.

It walks the ground model and reports every site that it passes. It gives the same bits as the fast
step of `serp._core`, is its oracle, and is the source of explanations.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

from serp.model import ground_model as g
from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED, UNSAFE
from serp.model.instructions import contested, enabling_earlier
from serp.pddl.syntax import Change


@dataclass(frozen=True, slots=True)
class Site:
    """A place in the ground model that a step passes.

    Attributes:
        what: `failed` (a precondition), `effect` (of an action or event, applied), `rate` (of a
            process, applied), `conflict` (of effects) or `undefined` (a result that is not a
            finite number, or a condition that is neither true nor false).
        schema: The ground action, process or event; None for the goal and the reward as a whole.
        item: The condition or effect; None where the schema as a whole is meant.
    """

    what: Literal["failed", "effect", "rate", "conflict", "undefined"]
    schema: g.GroundSchema | None
    item: g.Test | g.GroundEffect | None

    @property
    def without_result(self) -> str:
        """Say where a step ended here without a result, and why."""
        if self.what == "conflict":
            why = "contradicts another effect"
        elif isinstance(self.item, g.SetBoolean | g.SetNumber) or self.item is None:
            why = "does not give a finite number"
        else:
            why = "divides by zero, so it is neither true nor false"
        item = self.schema if self.item is None or isinstance(self.item, g.Constant) else self.item
        if item is None:
            return f"the reward {why}"
        place = item.place
        return f"{place.source.name}:{place.line}:{place.column}: `{place.text}` {why}"


class Passage(NamedTuple):
    """A site that a traced step passed; reward, and next state `[F + 1]`, right after it.

    The last of the values is the reward at the end of the previous part of the step.
    """

    site: Site
    gained: float
    values: list[float]


Amendment = Callable[[list[float], int, list[float]], None]
"""Changes the result of effects and processes; takes the state, the action and `out`."""


class Traced(NamedTuple):
    """Next state and reward `[F + 1]` (meaningless where not applicable), flags, and passages."""

    out: list[float]
    flags: int
    passages: list[Passage]


class TracedStep:
    """The step of a ground model."""

    def __init__(self, ground: g.GroundModel) -> None:
        self.ground = ground
        # Events after which those before them are looked at again.
        self.enabling = enabling_earlier(ground.events)

    def step(
        self,
        state: list[float],
        action: int,
        theta: Sequence[float],
        dt: float,
        amend: Amendment | None = None,
        outcome: int = 0,
    ) -> Traced:
        """Carry out an outcome of an action, -1 for no action while the world goes on.

        `amend` is called before the events are evaluated.
        """
        step = _Step(self, state, [*state, 0.0], theta, dt, outcome)
        return step.traced(lambda: step.predict(action, amend))

    def judge(
        self,
        state: list[float],
        action: int,
        next_state: list[float],
        theta: Sequence[float],
        dt: float,
        outcome: int = 0,
    ) -> Traced:
        """Return reward and flags of an observed transition; action -1 is not one of the model's.

        Next state and reward are what the events made of the observed one, or the predicted ones
        where the next state is as predicted. `outcome` is that of the action which took place.
        """
        predicted = self.step(state, action, theta, dt, outcome=outcome)
        if predicted.flags & APPLICABLE and predicted.out[:-1] == next_state:
            return predicted
        step = _Step(self, state, [*next_state, 0.0], theta, dt, outcome)
        return step.traced(lambda: step.judge(action, [*next_state]))

    def at_goal(self, state: list[float], theta: Sequence[float], dt: float) -> bool:
        """Whether the goal holds in a state; not where it has no truth value."""
        goal, step = self.ground.goal, _Step(self, state, [], theta, dt, 0)
        return goal is not None and step.truth(goal, state) is True


class _NoResult(Exception):
    """The step ends with these flags, without a result."""

    def __init__(self, flags: int) -> None:
        super().__init__()
        self.flags = flags


@dataclass
class _Step:
    """One step. `state` is where it begins; `out` becomes its result."""

    of: TracedStep
    state: list[float]
    out: list[float]
    theta: Sequence[float]
    dt: float
    outcome: int
    reward: float = 0.0
    set_flags: dict[int, bool] = field(
        default_factory=lambda: {g.UNSAFE_TARGET: False, g.TERMINAL_TARGET: False}
    )
    passages: list[Passage] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.ground = self.of.ground

    def traced(self, carry_out: Callable[[], None]) -> Traced:
        """Carry out the step and return its result."""
        try:
            carry_out()
            flags = APPLICABLE
            flags |= UNSAFE if self.set_flags[g.UNSAFE_TARGET] else 0
            flags |= TERMINAL if self.set_flags[g.TERMINAL_TARGET] else 0
        except _NoResult as end:
            flags = end.flags
        return Traced(self.out, flags, self.passages)

    def predict(self, action: int, amend: Amendment | None) -> None:
        """Carry out action, processes, events, metric and goal."""
        if action >= 0:
            self._act(self.ground.actions[action].as_outcome(self.outcome))
        self._rates(self.out)
        self._store_reward()
        if amend is not None:
            amend(self.state, action, self.out)
            self.reward = self.out[-1]
        self._events()
        self._goal_and_metric(self.out)
        self._store_reward()

    def judge(self, action: int, next_state: list[float]) -> None:
        """Carry out what concerns reward and flags, in an observed next state."""
        if action >= 0:
            schema = self.ground.actions[action].as_outcome(self.outcome)
            effects = [effect for effect in schema.effects if effect.target < 0]
            if self._all(schema.preconditions, self.state):
                self._effects(schema, effects, self.state)
        self._store_reward()
        self._rates(next_state, rewards_only=True)
        self._events()
        self._goal_and_metric(next_state)
        self._store_reward()

    # Reporting ---------------------------------------------------------------------------------

    def _report(self, site: Site) -> None:
        metric = self.ground.metric
        gained = self.reward if metric is None else self._metric_gain(metric, self.out, 0.0)
        self.passages.append(Passage(site, gained, self.out[:]))

    def _refuse(self, site: Site) -> None:
        """End the step without a result.

        A failed precondition sets no flag. Everything else sets UNDEFINED, and UNSAFE where that is
        certain by then: a step that cannot be predicted must not count as safe.
        """
        self._report(site)
        if site.what == "failed":
            raise _NoResult(0)
        raise _NoResult(UNDEFINED | (UNSAFE if self.set_flags[g.UNSAFE_TARGET] else 0))

    def _require_finite(self, fluents: Iterable[int], schema: g.GroundSchema) -> None:
        for fluent in sorted(fluent for fluent in fluents if fluent >= 0):
            if not math.isfinite(self.out[fluent]):
                self._refuse(Site("undefined", schema, None))

    def _store_reward(self) -> None:
        self.out[-1] = self.reward

    # Actions, processes and events -------------------------------------------------------------

    def _act(self, action: g.GroundSchema) -> None:
        doubts = []
        for test in action.preconditions:
            truth = self.truth(test, self.state)
            if truth is None:
                doubts.append(test)
            elif not truth:
                self._refuse(Site("failed", action, test))
        for test in doubts:
            self._refuse(Site("undefined", action, test))
        self._effects(action, action.effects, self.state)
        self._store_reward()

    def _rates(self, source: list[float], *, rewards_only: bool = False) -> None:
        """Carry out one explicit Euler step: every rate is evaluated before any is applied."""
        changes: list[tuple[g.GroundSchema, g.SetNumber, bool, float]] = []
        for process in self.ground.processes:
            effects = [e for e in process.effects if isinstance(e, g.SetNumber)]
            if rewards_only:
                effects = [e for e in effects if e.target == g.REWARD_TARGET]
            if effects:
                holds = self._decided(process, source)
                for effect in effects:
                    change = self.dt * self._value(effect.value, source)
                    changes.append((process, effect, holds, change))
        for process, effect, holds, change in changes:
            if holds:
                self._change(effect, change)
                self._report(Site("rate", process, effect))
        first = {effect.target: process for process, effect, _, _ in reversed(changes)}
        for target in sorted(first):
            self._require_finite([target], first[target])

    def _events(self) -> None:
        """Carry out events in file order, again where one has enabled an earlier one.

        Each fires once.
        """
        fired: set[int] = set()
        again = True
        while again:
            again = False
            for k, event in enumerate(self.ground.events):
                if k not in fired and self._decided(event, self.out):
                    fired.add(k)
                    again = again or k in self.of.enabling
                    self._effects(event, event.effects, self.out)

    def _goal_and_metric(self, result: list[float]) -> None:
        ground = self.ground
        if ground.metric is not None:
            self.reward = self._metric_gain(ground.metric, result, self.dt)
        if ground.goal is not None:
            reached = self.truth(ground.goal, result)
            if reached is None:
                self._refuse(Site("undefined", None, ground.goal))
            if reached:
                self.set_flags[g.TERMINAL_TARGET] = True
                if ground.goal_rewarded:
                    worth = ground.goal_parameter
                    self.reward = 1.0 if worth is None else self.reward + self.theta[worth]
        if not math.isfinite(self.reward):
            self._refuse(Site("undefined", None, None))

    def _metric_gain(self, metric: g.GroundMetric, result: list[float], elapsed: float) -> float:
        after = self._value(metric.value, result, elapsed)
        before = self._value(metric.value, self.state, 0.0)
        return after - before if metric.maximize else before - after

    # Effects -----------------------------------------------------------------------------------

    def _effects(
        self, schema: g.GroundSchema, effects: Sequence[g.GroundEffect], source: list[float]
    ) -> None:
        """Evaluate all effects before any is applied; deletes come before adds."""
        booleans = [e for e in effects if isinstance(e, g.SetBoolean)]
        numbers = [e for e in effects if isinstance(e, g.SetNumber)]
        ordered: list[g.GroundEffect] = [*sorted(booleans, key=lambda e: e.value), *numbers]
        conditions = self._conditions(schema, ordered, source)
        values = {id(effect): self._value(effect.value, source) for effect in numbers}
        groups: dict[int, str] = {}
        may_conflict = contested(numbers)
        for effect in ordered:
            if not conditions[id(effect.condition)]:
                continue
            if isinstance(effect, g.SetBoolean):
                self._set_boolean(effect)
            else:
                value = values[id(effect)]
                if effect.target in may_conflict:
                    self._refuse_conflict(schema, effect, value, groups)
                self._change(effect, value)
            self._report(Site("effect", schema, effect))
        self._require_finite({effect.target for effect in numbers}, schema)

    def _conditions(
        self, schema: g.GroundSchema, effects: Sequence[g.GroundEffect], source: list[float]
    ) -> dict[int, bool | None]:
        """Return the truth values of the conditions of effects, by id.

        Where one of them is undefined, the effects on `(unsafe)` whose conditions hold still count.
        """
        tests = {id(effect.condition): effect.condition for effect in effects}
        truths = {key: self.truth(test, source) for key, test in tests.items()}
        if None in truths.values():
            if any(truths[id(e.condition)] for e in effects if e.target == g.UNSAFE_TARGET):
                self.set_flags[g.UNSAFE_TARGET] = True
            undefined = next(tests[key] for key, truth in truths.items() if truth is None)
            self._refuse(Site("undefined", schema, undefined))
        return truths

    def _set_boolean(self, effect: g.SetBoolean) -> None:
        if effect.target in self.set_flags:
            self.set_flags[effect.target] = effect.value
        else:
            self.out[effect.target] = float(effect.value)

    def _refuse_conflict(
        self, schema: g.GroundSchema, effect: g.SetNumber, value: float, groups: dict[int, str]
    ) -> None:
        """End the step where an earlier effect contradicts this one; note the kind of its change.

        Changes of one group commute; equal assignments agree.
        """
        group, earlier = effect.change.group, groups.get(effect.target)
        assigned = earlier == "assign" == group
        if earlier not in (None, group) or (assigned and self.out[effect.target] != value):
            self._refuse(Site("conflict", schema, effect))
        groups[effect.target] = group

    def _change(self, effect: g.SetNumber, value: float) -> None:
        is_reward = effect.target == g.REWARD_TARGET
        number = self.reward if is_reward else self.out[effect.target]
        match effect.change:
            case Change.ASSIGN:
                number = value
            case Change.INCREASE:
                number = number + value
            case Change.DECREASE:
                number = number - value
            case Change.SCALE_UP:
                number = number * value
            case Change.SCALE_DOWN:
                number = _quotient(number, value)
        if is_reward:
            self.reward = number
        else:
            self.out[effect.target] = number

    # Conditions and numbers --------------------------------------------------------------------

    def _decided(self, schema: g.GroundSchema, source: list[float]) -> bool:
        """Return whether the precondition of a process or event holds; it must not be undefined."""
        tests = schema.preconditions
        truth = self._all(tests, source)
        if truth is None:
            whole = tests[0] if len(tests) == 1 else g.All(tests, schema.place)
            self._refuse(Site("undefined", schema, whole))
        return truth is True

    def truth(self, test: g.Test, source: list[float]) -> bool | None:
        """Return the truth value of a condition; None where it is undefined (Kleene's logic)."""
        match test:
            case g.Compare(symbol, left, right):
                one, other = self._value(left, source), self._value(right, source)
                undefined = math.isnan(one) or math.isnan(other)
                return None if undefined else _COMPARISONS[symbol](one, other)
            case g.Holds(fluent) if fluent >= 0:
                return source[fluent] != 0.0
            case g.Holds(flag):  # before the action, both are false
                return source is not self.state and self.set_flags[flag]
            case g.Not(operand):
                truth = self.truth(operand, source)
                return None if truth is None else not truth
            case g.All(operands):
                return self._all(operands, source)
            case g.AnyOf(operands):
                truths = {self.truth(operand, source) for operand in operands}
                return True if True in truths else None if None in truths else False
            case g.Constant(value):
                return value

    def _all(self, tests: Iterable[g.Test], source: list[float]) -> bool | None:
        """Return the truth value of a conjunction."""
        whole: bool | None = True
        for test in tests:
            truth = self.truth(test, source)
            if truth is False:
                return False
            whole = whole and truth
        return whole

    def _value(self, value: g.Value, source: list[float], elapsed: float | None = None) -> float:
        """Return a number; NaN where it has no result. `elapsed` is the control period."""
        match value:
            case g.Read(fluent):
                return source[fluent]
            case g.ParameterRef(parameter):
                return self.theta[parameter]
            case g.Elapsed():
                return self.dt if elapsed is None else elapsed
            case g.Operation(symbol, left, right):
                one = self._value(left, source, elapsed)
                return _OPERATIONS[symbol](one, self._value(right, source, elapsed))
            case g.Unary(symbol, operand):
                return _UNARY[symbol](self._value(operand, source, elapsed))


# Arithmetic without an exception. What has no result is NaN, and NaN gives NaN.


def _quotient(dividend: float, divisor: float) -> float:
    return dividend / divisor if divisor != 0.0 else math.nan


_COMPARISONS: Final[dict[str, Callable[[float, float], bool]]] = {
    "<": operator.lt, "<=": operator.le, "=": operator.eq, ">=": operator.ge, ">": operator.gt,
}  # fmt: skip
_OPERATIONS: Final[dict[str, Callable[[float, float], float]]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": _quotient,
    "min": lambda one, other: one if one < other or math.isnan(one) else other,
    "max": lambda one, other: one if one > other or math.isnan(one) else other,
    "atan2": math.atan2,
}
_UNARY: Final[dict[str, Callable[[float], float]]] = {
    "-": operator.neg,
    "abs": lambda number: number if number > 0.0 else 0.0 - number,
    "sqrt": lambda number: math.sqrt(number) if number >= 0.0 else math.nan,
    "sin": lambda number: math.sin(number) if math.isfinite(number) else math.nan,
    "cos": lambda number: math.cos(number) if math.isfinite(number) else math.nan,
}
