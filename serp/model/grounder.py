"""Instantiation: schemas over objects → ground actions, processes and events.

A ground predicate or function that cannot vary (see `serp.model.reachability`) is a constant: it
can rule instances out, and has no column of the state. All others are fluents.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction

from serp._util.did_you_mean import listed
from serp.model import ground_model as g
from serp.model.ground_model import ELAPSED, linear
from serp.model.reachability import (
    MAX_GROUND_SCHEMAS,
    Binding,
    Facts,
    Key,
    bound,
    conjuncts,
    key_of,
    reachable,
)
from serp.pddl import syntax as x
from serp.pddl.source import DomainError, Place
from serp.pddl.syntax import Change

STEPS = 100
UNBOUNDED = 1_000_000.0
"""The reward for reaching the goal where the gain of the metric is not bounded."""

_SIGNS = {Change.INCREASE: 1.0, Change.DECREASE: -1.0}
_Changes = tuple[g.SetNumber, ...]
_Effects = tuple[g.GroundEffect, ...]
MOST_EXPANSIONS = 20_000
"""Most derived atoms that are written out; recursive ones may be written out several times."""
MOST_OUTCOMES = 16
"""Most outcomes of a ground action, as in `model.hpp`."""


class GoalValue:
    """The reward for reaching the goal of a model with a metric, as a function of θ."""

    def __init__(self, ground: g.GroundModel) -> None:
        assert ground.metric is not None
        self.metric = ground.metric.value
        read = set(g.fluents_of(self.metric))

        def relevant(schemas: Iterable[g.GroundSchema]) -> list[_Changes]:
            numbers = (
                tuple(e for e in effects if isinstance(e, g.SetNumber) and e.target in read)
                for s in schemas
                for effects in (s.effects, *(outcome.effects for outcome in s.outcomes))
            )
            return [effects for effects in numbers if effects]

        self.actions = list(dict.fromkeys(relevant(ground.actions)))
        self.processes = relevant(ground.processes)
        self.events = relevant(ground.events)

    def bounded(self, theta: Sequence[float], dt: float) -> bool:
        """Whether the gain of the metric in a step is bounded."""
        return math.isfinite(self._range(theta, dt))

    def value(self, theta: Sequence[float], dt: float) -> float:
        """Return the reward for given parameters and a control period."""
        worth = 1.0 + STEPS * self._range(theta, dt)
        return worth if math.isfinite(worth) else UNBOUNDED

    def _range(self, theta: Sequence[float], dt: float) -> float:
        terms = linear(self.metric, theta).terms
        weights = {atom: _number(factor) for atom, factor in terms.items() if isinstance(atom, int)}
        elapsed = _number(terms.get(ELAPSED, Fraction(0))) * dt
        if len(weights) + (ELAPSED in terms) < len(terms):  # not linear
            return math.inf
        low, high = min(elapsed, 0.0), max(elapsed, 0.0)
        steps = [_change(effects, weights, theta) for effects in self.actions]
        low += min((a for a, _ in steps), default=0.0)
        high += max((b for _, b in steps), default=0.0)
        for times, schemas in ((dt, self.processes), (1.0, self.events)):
            for effects in schemas:
                a, b = _change(effects, weights, theta)
                low += times * a
                high += times * b
        return high - low


def _change(
    effects: _Changes, weights: dict[int, float], theta: Sequence[float]
) -> tuple[float, float]:
    """Bound the change of the metric by effects that may or may not be applied."""
    low = high = 0.0
    for effect in effects:
        weight = weights.get(effect.target, 0.0)
        if not weight:
            continue
        sign, amount = _SIGNS.get(effect.change), linear(effect.value, theta)
        if sign is None or amount.terms:
            return -math.inf, math.inf
        change = sign * weight * _number(amount.constant)
        low, high = low + min(change, 0.0), high + max(change, 0.0)
    return low, high


def _number(fraction: Fraction) -> float:
    try:
        return float(fraction)
    except OverflowError:
        return math.inf


_FLAGS: dict[Key, int] = {(x.UNSAFE,): g.UNSAFE_TARGET, (x.TERMINAL,): g.TERMINAL_TARGET}
_TRUE = g.Constant(True)


def instantiate(
    domain: x.DomainSyntax,
    problem: x.ProblemSyntax | None = None,
    *,
    supplied: Collection[str] | None = None,
    max_ground_schemas: int = MAX_GROUND_SCHEMAS,
) -> g.GroundModel:
    """Instantiate a domain over the objects of its problem (or over its constants).

    Args:
        domain: The parsed domain.
        problem: The parsed problem, if there is one.
        supplied: None where all states can be reached from the problem's `:init`. Otherwise states
            are observed and any state is possible; the names are those of fluents that are observed
            although `:init` states them and no effect changes them.
        max_ground_schemas: Most ground actions, processes and events together, and most fluents.
            The limit is 20 times as high for bindings that are tried.
    """
    facts = Facts(domain, problem, supplied, max_ground_schemas)
    try:
        return _Instantiation(facts, problem).run()
    except RecursionError:
        raise _derived_too_often(domain.axioms[0].name, domain.axioms[0].place) from None


def _derived_too_often(name: str, place: Place) -> DomainError:
    problem = f"`{name}` has too many derivations over these objects"
    advice = "use fewer objects, or set the predicate in events"
    return DomainError(problem, place, advice, code="too-large")


class _MissingValue(DomainError):
    """A static number that is read and that the problem does not give."""

    def __init__(self, key: Key, read: Place, problem: x.ProblemSyntax | None) -> None:
        self.key = key
        init = problem.init if problem is not None else None
        super().__init__(
            f"`({' '.join(key)})` has no value, but `{read}` reads it",
            (init or read).opening,
            f"the problem gives values to other instances of `{key[0]}`; add "
            f"`(= ({' '.join(key)}) ...)` to its :init",
            code="missing-value",
        )


class _Instantiation:
    def __init__(self, facts: Facts, problem: x.ProblemSyntax | None) -> None:
        self.domain = facts.domain
        self.problem = problem
        self.facts = facts
        self.parameters: list[g.Parameter] = []
        self.parameter_at: dict[tuple[int, int], int] = {}
        self.axioms: dict[str, list[x.Axiom]] = {}
        for axiom in facts.domain.axioms:
            self.axioms.setdefault(axiom.name, []).append(axiom)
        parts = ((s.name, part) for s in self.domain.schemas for part in x.nodes_in(s.effects))
        self.by_chance = {name for name, part in parts if isinstance(part, x.Chance)}
        self.derived: dict[Key, g.Test] = {}
        self.deriving: dict[Key, set[Key]] = {}
        """Derived atoms that are being expanded → atoms that were cut off within."""
        self.quantified: dict[object, g.Test] = {}
        self.universal: dict[object, _Effects] = {}
        self.expansions = 0
        self.sizes: dict[int, tuple[g.Test, int]] = {}
        self.left_out: dict[Key, list[str]] = {}
        """Static number without a value → names of the instances that read it."""

    def run(self) -> g.GroundModel:
        self.facts.free_missing_numbers()
        bindings = reachable(self.facts)
        self.fluents = self._fluents()
        self.index = {fluent.key: fluent.index for fluent in self.fluents}
        ground: dict[x.Kind, list[g.GroundSchema]] = {kind: [] for kind in x.Kind}
        for schema in self.domain.schemas:
            instances = (self._instance(schema, binding) for binding in bindings[schema.name])
            ground[schema.kind] += [instance for instance in instances if instance is not None]
        self._warn_of_missing_values()
        goal = self._goal()
        metric = self._metric()
        worth = self.problem.goal_reward if self.problem is not None else None
        goal_parameter = None if worth is None else self._parameter(worth, "goal").parameter
        model = g.GroundModel(
            syntax=self.domain,
            fluents=self.fluents,
            parameters=tuple(self.parameters),
            actions=tuple(ground[x.Kind.ACTION]),
            processes=tuple(ground[x.Kind.PROCESS]),
            events=tuple(ground[x.Kind.EVENT]),
            goal=goal,
            goal_rewarded=goal is not None
            and (worth is not None or x.REWARD not in self.domain.declarations),
            goal_parameter=goal_parameter,
            metric=metric,
            initial=self._initial(goal, metric, itertools.chain(*ground.values())),
            static=self._static_values(),
        )
        return _with_goal_value(model) if goal is not None and metric is not None else model

    # Fluents -----------------------------------------------------------------------------------

    def _fluents(self) -> tuple[g.Fluent, ...]:
        fluents: list[g.Fluent] = []
        free: dict[str, list[Key]] = {}
        for key in self.facts.free:
            free.setdefault(key[0], []).append(key)
        for declaration in self.domain.declarations.values():
            name = declaration.name
            if declaration.reserved or name in self.axioms:
                continue
            keys: Iterable[Key] = self.facts.in_order(free.get(name, ()))
            if name in self.facts.varying:
                keys = self.facts.keys_of(declaration)
            for key in keys:
                self.facts.check_fluents(len(fluents) + 1, declaration)
                fluents.append(
                    g.Fluent(" ".join(key), len(fluents), declaration.numeric, name, key[1:])
                )
        return tuple(fluents)

    def _initial(
        self, goal: g.Test | None, metric: g.GroundMetric | None, schemas: Iterable[g.GroundSchema]
    ) -> tuple[float, ...] | None:
        """Return the initial state; None where numbers are missing that will be observed."""
        if self.problem is None:
            return None
        facts = self.facts
        initial: list[float] = []
        missing: dict[str, list[g.Fluent]] = {}
        for fluent in self.fluents:
            number = facts.values.get(fluent.key)
            if fluent.numeric and number is None:
                missing.setdefault(fluent.symbol, []).append(fluent)
            initial.append(number.value if number else float(fluent.key in facts.true))
        if missing and not facts.closed:
            return None
        used = set(g.fluents_of(goal)) if goal is not None else set()
        used.update(g.fluents_of(metric.value) if metric is not None else ())
        for schema in schemas if missing else ():
            used |= g.reads(schema) | g.writes(schema)
        for symbol, fluents in missing.items():
            names = [fluent.name for fluent in fluents if fluent.index in used]
            if names:
                self.domain.declarations[symbol].place.warn(
                    f"{listed(names, 3)} {'starts' if len(names) == 1 else 'start'} at 0, because "
                    ":init gives no value",
                    "missing-value",
                )
        return tuple(initial)

    def _static_values(self) -> dict[str, float]:
        stated = dict.fromkeys(sorted(self.facts.true), 1.0)
        stated.update((key, number.value) for key, number in self.facts.values.items())
        return {" ".join(key): value for key, value in stated.items() if key not in self.index}

    # Instances ---------------------------------------------------------------------------------

    def _instance(self, schema: x.Schema, binding: Binding) -> g.GroundSchema | None:
        """Return an instance; None where it can never apply, or reads what has no value."""
        try:
            return self._complete_instance(schema, binding)
        except _MissingValue as missing:
            arguments = (binding[p.name] for p in schema.parameters)
            name = " ".join((schema.name, *arguments))
            self.left_out.setdefault(missing.key, []).append(name)
            return None

    def _warn_of_missing_values(self) -> None:
        for key, names in self.left_out.items():
            init = self.problem.init if self.problem is not None else None
            place = init or self.domain.declarations[key[0]].place
            place.opening.warn(
                f"`({' '.join(key)})` has no value, so these forms, which read it, never apply: "
                f"{listed(names, 3)}",
                "missing-value",
                advice=f"the problem file gives values to other instances of `{key[0]}`; if these "
                f"forms should apply, add `(= ({' '.join(key)}) ...)` to its :init",
            )

    def _complete_instance(self, schema: x.Schema, binding: Binding) -> g.GroundSchema | None:
        test = self._test(schema.precondition, binding)
        if test == g.Constant(False):
            return None
        preconditions: tuple[g.Test, ...] = () if test == _TRUE else (test,)
        if isinstance(test, g.All):
            preconditions = test.operands
        role = "rate" if schema.kind is x.Kind.PROCESS else "effect"
        if schema.name in self.by_chance:
            first, *others = self._outcomes(schema.effects, binding, _TRUE, role)
            effects = first.effects
        else:
            effects, others = tuple(self._effects(schema.effects, binding, _TRUE, role)), []
        arguments = tuple(binding[p.name] for p in schema.parameters)
        return g.GroundSchema(
            kind=schema.kind,
            name=" ".join((schema.name, *arguments)),
            schema=schema.name,
            arguments=arguments,
            preconditions=preconditions,
            effects=effects,
            place=schema.place,
            outcomes=tuple(others),
        )

    # Expressions -------------------------------------------------------------------------------

    def _parameter(self, number: x.Number, role: str) -> g.ParameterRef:
        """Return the entry of θ for a number; instances of one schema share it."""
        at = (id(number.place.source), number.place.start)
        index = self.parameter_at.setdefault(at, len(self.parameters))
        if index == len(self.parameters):
            self.parameters.append(g.Parameter(index, number.value, role, number.place))
        return g.ParameterRef(index)

    def _value(self, expression: x.Expression, binding: Binding, role: str) -> g.Value:
        match expression:
            case x.Number():
                return self._parameter(expression, role)
            case x.FunctionTerm(name, arguments, place):
                key = key_of(name, arguments, binding)
                if key in self.index:
                    return g.Read(self.index[key])
                if key not in self.facts.values:
                    raise _MissingValue(key, place, self.problem)
                return self._parameter(self.facts.values[key], "initial")
            case x.TotalTime():
                return g.Elapsed()
            case x.Arithmetic(operator, operands, _):
                values = [self._value(operand, binding, role) for operand in operands]
                if len(values) == 1:
                    return g.Unary(operator, values[0])
                result = values[0]
                for value in values[1:]:
                    result = g.Operation(operator, result, value)
                return result

    def _test(self, condition: x.Condition, binding: Binding) -> g.Test:
        match condition:
            case x.Atom(name, arguments, place):
                key = key_of(name, arguments, binding)
                if key in _FLAGS:
                    return g.Holds(_FLAGS[key], place)
                if name in self.axioms:
                    return self._derive(key, place)
                if key in self.index:
                    return g.Holds(self.index[key], place)
                return g.Constant(key in self.facts.true)
            case x.SameObject(left, right, _):
                return g.Constant(bound(left, binding) == bound(right, binding))
            case x.NumericComparison(operator, left, right, place):
                return g.Compare(
                    operator,
                    self._value(left, binding, "condition"),
                    self._value(right, binding, "condition"),
                    place,
                )
            case x.Connective(operator, operands, place):
                return self._connective(operator, operands, place, binding)
            case x.Quantified(operator, parameters, body, place):
                occurrence = self.facts.occurrence(condition, binding)
                if occurrence in self.quantified:
                    return self.quantified[occurrence]
                bindings = self.facts.quantify(parameters, binding, place)
                tests = (self._test(body, inner) for inner in bindings)
                joined = _join(tests, place, conjunction=operator == "forall")
                if not self.deriving:  # else an atom may have been cut off
                    self.quantified[occurrence] = joined
                return joined

    def _derive(self, key: Key, place: Place) -> g.Test:
        """Return the condition that a derived atom stands for.

        An atom within its own derivation is false: the shortest derivation does without it, so this
        is the least fixed point of recursive axioms (van Emden & Kowalski, JACM 23, 1976).
        """
        if key in self.deriving:
            within = list(self.deriving)
            for inner in within[within.index(key) :]:
                self.deriving[inner].add(key)
            return g.Constant(False)
        if key in self.derived:
            return self.derived[key]
        cut = self.deriving[key] = set()
        tests = []
        for axiom in self.axioms[key[0]]:
            typed = zip(axiom.parameters, key[1:], strict=True)
            if all(name in self.facts.objects_of(p.types) for p, name in typed):
                names = (parameter.name for parameter in axiom.parameters)
                tests.append(self._test(axiom.condition, dict(zip(names, key[1:], strict=True))))
        test = _join(tests, place, conjunction=False)
        del self.deriving[key]
        self.expansions += 1
        if self.expansions > MOST_EXPANSIONS or self._size(test) > MOST_EXPANSIONS:
            raise _derived_too_often(key[0], place)
        if cut <= {key}:  # else it depends on what it was derived for
            self.derived[key] = test
        return test

    def _size(self, test: g.Test) -> int:
        """Return how many parts a condition has when it is written out."""
        if id(test) not in self.sizes:
            parts = getattr(test, "operands", ()) or (getattr(test, "operand", None),)
            size = 1 + sum(self._size(part) for part in parts if part is not None)
            self.sizes[id(test)] = test, size
        return self.sizes[id(test)][1]

    def _connective(
        self, operator: str, operands: tuple[x.Condition, ...], place: Place, binding: Binding
    ) -> g.Test:
        tests = (self._test(operand, binding) for operand in operands)
        if operator == "not":
            return _negate(next(tests), place)
        if operator == "imply":
            premise = _negate(next(tests), place)
            return _join(itertools.chain([premise], tests), place, conjunction=False)
        return _join(tests, place, conjunction=operator == "and")

    # Effects -----------------------------------------------------------------------------------

    def _effects(
        self, effects: tuple[x.Effect, ...], binding: Binding, condition: g.Test, role: str
    ) -> Iterator[g.GroundEffect]:
        for effect in effects:
            match effect:
                case x.SetPredicate(atom, value, place):
                    key = key_of(atom.name, atom.arguments, binding)
                    target = _FLAGS.get(key, self.index.get(key))
                    if target is not None:  # a constant already has this value
                        yield g.SetBoolean(target, value, condition, place)
                case x.ChangeFunction(change, function, value, place):
                    key = key_of(function.name, function.arguments, binding)
                    target = g.REWARD_TARGET if function.name == x.REWARD else self.index[key]
                    yield g.SetNumber(
                        target, change, self._value(value, binding, role), condition, place
                    )
                case x.When(test, inner, place):
                    joined = _join(
                        [condition, self._test(test, binding)], test.place, conjunction=True
                    )
                    if joined != g.Constant(False):
                        yield from self._effects(inner, binding, joined, role)
                case x.ForallEffect(parameters, inner, place):
                    occurrence = condition is _TRUE and self.facts.occurrence(effect, binding)
                    effects_of_all = self.universal.get(occurrence)
                    if effects_of_all is None:
                        effects_of_all = tuple(
                            ground
                            for extended in self.facts.quantify(parameters, binding, place)
                            for ground in self._effects(inner, extended, condition, role)
                        )
                        if occurrence:
                            self.universal[occurrence] = effects_of_all
                    yield from effects_of_all

    def _outcomes(
        self, effects: tuple[x.Effect, ...], binding: Binding, condition: g.Test, role: str
    ) -> list[g.GroundOutcome]:
        """Return what effects come to, by chance, the likeliest first; they are independent."""
        found = [g.GroundOutcome(1.0, ())]
        for effect in effects:
            for parts in self._parts(effect, binding, condition, role):
                joint: dict[_Effects, float] = {}
                for one, other in itertools.product(found, parts):
                    both = (*one.effects, *other.effects)
                    joint[both] = joint.get(both, 0.0) + one.probability * other.probability
                if len(joint) > MOST_OUTCOMES:
                    raise DomainError(
                        f"this action has more than {MOST_OUTCOMES} outcomes", effect.place,
                        "write one action for each random event",
                        code="too-large",
                    )  # fmt: skip
                found = [g.GroundOutcome(p, both) for both, p in joint.items()]
        return sorted(found, key=lambda outcome: -outcome.probability)

    def _parts(
        self, effect: x.Effect, binding: Binding, condition: g.Test, role: str
    ) -> Iterator[list[g.GroundOutcome]]:
        """Yield the outcomes of each independent part of an effect."""
        match effect:
            case x.Chance(outcomes):
                parts = [
                    g.GroundOutcome(chosen.probability * inner.probability, inner.effects)
                    for chosen in outcomes
                    for inner in self._outcomes(chosen.effects, binding, condition, role)
                ]
                rest = 1.0 - math.fsum(chosen.probability for chosen in outcomes)
                yield [*parts, *([g.GroundOutcome(rest, ())] if rest > 1e-9 else [])]
            case x.When(test, inner, _):
                joined = _join([condition, self._test(test, binding)], test.place, conjunction=True)
                if joined != g.Constant(False):
                    yield self._outcomes(inner, binding, joined, role)
            case x.ForallEffect(parameters, inner, place):
                for extended in self.facts.quantify(parameters, binding, place):
                    yield self._outcomes(inner, extended, condition, role)
            case _:
                plain = tuple(self._effects((effect,), binding, condition, role))
                yield [g.GroundOutcome(1.0, plain)]

    # Problem -----------------------------------------------------------------------------------

    def _goal(self) -> g.Test | None:
        goal = self.problem.goal if self.problem else None
        if goal is None or not any(conjuncts(goal)):  # `()`, `(and)`: a task without a goal
            return None
        return self._test(goal, {})

    def _metric(self) -> g.GroundMetric | None:
        metric = self.problem.metric if self.problem else None
        if metric is None:
            return None
        expression = metric.expression
        if isinstance(expression, x.FunctionTerm) and expression.name == x.REWARD:
            if not metric.maximize:
                raise DomainError(
                    "`(reward)` is maximised, never minimised", metric.place, code="reserved-name"
                )
            return None
        if x.REWARD in self.domain.declarations:
            raise DomainError(
                "the domain declares `(reward)`, so the metric can only be "
                "`(:metric maximize (reward))`",
                metric.place,
                code="reserved-name",
            )
        return g.GroundMetric(metric.maximize, self._value(expression, {}, "metric"), metric.place)


def _with_goal_value(model: g.GroundModel) -> g.GroundModel:
    """Add the reward for reaching the goal to the parameters."""
    assert model.metric is not None
    worth = GoalValue(model)
    written = [parameter.value for parameter in model.parameters]
    if not worth.bounded(written, 1.0):
        model.metric.place.warn(
            "the files set no limit on what this can gain in a step, so reaching the goal is worth "
            f"{UNBOUNDED:,.0f}",
            "unbounded-goal",
        )
    index = len(written)
    parameter = g.Parameter(index, worth.value(written, 1.0), "goal", model.metric.place)
    return replace(model, parameters=(*model.parameters, parameter), goal_parameter=index)


def _negate(test: g.Test, place: Place) -> g.Test:
    if isinstance(test, g.Constant):
        return g.Constant(not test.value)
    if isinstance(test, g.Not):
        return test.operand
    return g.Not(test, place)


def _join(tests: Iterable[g.Test], place: Place, *, conjunction: bool) -> g.Test:
    """Join tests, flattening the same connective and resolving constants.

    Tests after a deciding one are skipped: a distance needs no value where there is no road.
    """
    flat: list[g.Test] = []
    same = g.All if conjunction else g.AnyOf
    for test in tests:
        if isinstance(test, g.Constant):
            if test.value != conjunction:  # false in a conjunction, true in a disjunction: decides
                return g.Constant(test.value)
            continue
        if isinstance(test, same):
            flat.extend(test.operands)
        else:
            flat.append(test)
    if not flat:
        return g.Constant(conjunction)
    if len(flat) == 1:
        return flat[0]
    return same(tuple(flat), place)
