"""A slow, obvious reading of the domain language, to hold the compiled one against.

It walks the syntax as written, with variables looked up when they are met, and a state is a
dictionary from ground terms to values. Nothing here is shared with `serp.model.grounder` or
`serp.model.instructions`; only the parsed syntax is the same.
"""

import functools
import itertools
import math
import operator
from dataclasses import dataclass

from serp.pddl import syntax as x

Key = tuple[str, ...]
"""A ground predicate or function: its name and the objects."""
State = dict[Key, bool | float]
UNKNOWN = 0.5
TIME: Key = ("total-time",)
"""Where a state has the time that has passed, for a metric."""


@dataclass(frozen=True)
class Prediction:
    """What one step leads to."""

    state: State
    reward: float
    unsafe: bool
    terminal: bool
    applicable: bool


class NotApplicable(Exception):
    """The step has no result."""


class Oracle:
    """One domain and problem, stepped by the book."""

    def __init__(self, domain, problem=None, goal_worth=lambda dt: 1.0):
        """Take the files as written, and what the goal is worth for a control period."""
        self.domain = domain
        self.problem = problem
        self.goal_worth = goal_worth
        self.objects = problem.objects if problem else domain.constants
        self._readings = {}

    # What there is -----------------------------------------------------------------------------

    def bindings(self, parameters):
        """Every way to bind the parameters to objects, in the order of the files."""
        choices = [
            [o.name for o in self.objects.values() if self.fits(o.type, p.types)]
            for p in parameters
        ]
        for chosen in itertools.product(*choices):
            yield {p.name: name for p, name in zip(parameters, chosen, strict=True)}

    def fits(self, type_name, wanted):
        """Whether something of a type may stand where one of the wanted types is asked for."""
        while True:
            if type_name in wanted or x.OBJECT in wanted:
                return True
            if type_name not in self.domain.parents:
                return False
            type_name = self.domain.parents[type_name]

    def terms(self):
        """Every ground predicate (False) and function (True), reserved ones left out."""
        return {
            (declaration.name, *binding.values()): declaration.numeric
            for declaration in self.domain.declarations.values()
            if declaration.name not in (x.REWARD, x.UNSAFE, x.TERMINAL)
            for binding in self.bindings(declaration.parameters)
        }

    def initial(self):
        """What the problem states; numbers that it leaves open are missing."""
        state = {key: False for key, numeric in self.terms().items() if not numeric}
        if self.problem is not None:
            for atom in self.problem.true_atoms:
                state[ground(atom, {})] = True
            for function, number in self.problem.values:
                state[ground(function, {})] = number.value
        return state

    def instances(self, kind):
        """Printable name → schema and binding, in the order of the file."""
        return self._instances[kind]

    @functools.cached_property
    def _instances(self):
        return {
            kind: {
                " ".join((schema.name, *binding.values())): (schema, binding)
                for schema in self.domain.schemas
                if schema.kind is kind
                for binding in self.bindings(schema.parameters)
            }
            for kind in x.Kind
        }

    # One step ----------------------------------------------------------------------------------

    def step(self, state, action, dt=1.0):
        """Predict one step of length `dt`."""
        schema, binding = self.instances(x.Kind.ACTION)[action]
        try:
            return self._step(state, schema, binding, dt)
        except NotApplicable:
            return Prediction(state, 0.0, False, False, False)

    def _step(self, before, schema, binding, dt):
        fresh = {(x.REWARD,): 0.0, (x.UNSAFE,): False, (x.TERMINAL,): False}
        state = {**before, **fresh}
        if not self.enabled(schema, state, binding):
            raise NotApplicable
        state = self.changed(state, [(schema, binding)])
        flowing = [
            (process, bound)
            for process, bound in self.instances(x.Kind.PROCESS).values()
            if self.enabled(process, state, bound)
        ]
        state = self.changed(state, flowing, rate_time=dt)
        state = self._after_events(state)
        goal = self.problem.goal if self.problem else None
        reached = goal is not None and not is_empty(goal) and self._holds(goal, {})(state)
        reward = self._reward(before, state, dt)
        if reached and x.REWARD not in self.domain.declarations:
            reward += self.goal_worth(dt)
        if not math.isfinite(reward):
            raise NotApplicable
        after = {key: value for key, value in state.items() if key not in fresh}
        unsafe = bool(state[(x.UNSAFE,)])
        return Prediction(after, reward, unsafe, bool(state[(x.TERMINAL,)]) or reached, True)

    def _after_events(self, state):
        waiting = dict(self.instances(x.Kind.EVENT))
        while True:
            fired = []
            for name, (event, binding) in waiting.items():
                if self.enabled(event, state, binding):
                    state = self.changed(state, [(event, binding)])
                    fired.append(name)
            if not fired:
                return state
            for name in fired:
                del waiting[name]

    def _reward(self, before, after, dt):
        metric = self.problem.metric if self.problem else None
        if metric is None or x.REWARD in self.domain.declarations:
            return float(after[(x.REWARD,)])
        value = self._once(metric.expression, {}, self.value)
        late, early = value({**after, TIME: dt}), value({**before, TIME: 0.0})
        return late - early if metric.maximize else early - late

    # What follows reads the syntax under a binding once, as a function of the state.

    def enabled(self, schema, state, binding):
        """Whether the precondition holds."""
        return self._holds(schema.precondition, binding)(state)

    def _holds(self, condition, binding):
        """Whether a condition is true; one that is undefined ends the step."""
        return self._once(condition, binding, self._read_holds)

    def _once(self, part, binding, read):
        key = id(part), *binding.items()  # of the syntax, which lives as long
        if key not in self._readings:
            self._readings[key] = read(part, binding)
        return self._readings[key]

    def _read_holds(self, condition, binding):
        truth = self.truth(condition, binding)

        def holds(state):
            value = truth(state)
            if value == UNKNOWN:
                raise NotApplicable
            return value == 1

        return holds

    # Effects -----------------------------------------------------------------------------------

    def changed(self, state, together, rate_time=None):
        """Apply the effects of some schemas together: all are evaluated before any is applied."""
        deletes = []
        adds = []
        numbers = []
        for schema, binding in together:
            for change, key, value in self._once(schema.effects, binding, self.effects)(state):
                if change is None:
                    (adds if value else deletes).append(key)
                else:
                    numbers.append((change, key, value if rate_time is None else rate_time * value))
        refuse_contradictions(numbers)
        after = dict(state)
        after.update({key: False for key in deletes})
        after.update({key: True for key in adds})
        for change, key, value in numbers:
            after[key] = CHANGES[change](float(after[key]), value)
        for _, key, _ in numbers:
            if key != (x.REWARD,) and not math.isfinite(after[key]):
                raise NotApplicable
        return after

    def effects(self, effects, binding):
        """Function of the state: the simple effects that happen, each a change, key and value.

        The change of a predicate is None.
        """
        parts = [self.effect(effect, binding) for effect in effects]
        return lambda state: [simple for part in parts for simple in part(state)]

    def effect(self, effect, binding):
        """One of `effects`."""
        match effect:
            case x.When(condition, inner):
                holds, parts = self._read_holds(condition, binding), self.effects(inner, binding)
                return lambda state: parts(state) if holds(state) else ()
            case x.ForallEffect(parameters, inner):
                each = [self.effects(inner, {**binding, **m}) for m in self.bindings(parameters)]
                return lambda state: [simple for parts in each for simple in parts(state)]
            case x.SetPredicate(atom, truth):
                simple = [(None, ground(atom, binding), truth)]
                return lambda state: simple
            case x.ChangeFunction():
                change, key = effect.change, ground(effect.function, binding)
                value = self.value(effect.value, binding)
                return lambda state: [(change, key, value(state))]

    # Conditions and values ---------------------------------------------------------------------

    def truth(self, condition, binding):
        """1 (true), 0 (false) or UNKNOWN, where it depends on a number that is NaN (Kleene)."""
        match condition:
            case x.Atom():
                key = ground(condition, binding)
                return lambda state: bool(state[key])
            case x.SameObject(left, right):
                same = bound(left, binding) == bound(right, binding)
                return lambda state: same
            case x.NumericComparison(symbol, left_side, right_side):
                left, right = self.value(left_side, binding), self.value(right_side, binding)
                compared = COMPARISONS[symbol]

                def comparison(state):
                    one, other = left(state), right(state)
                    return UNKNOWN if one != one or other != other else compared(one, other)

                return comparison
            case x.Connective(word, operands):
                parts = [self.truth(operand, binding) for operand in operands]
                match word:
                    case "and":
                        return lambda state: min([part(state) for part in parts], default=1)
                    case "or":
                        return lambda state: max([part(state) for part in parts], default=0)
                    case "not":
                        return lambda state: 1 - parts[0](state)
                    case _:  # imply
                        return lambda state: max(1 - parts[0](state), parts[1](state))
            case x.Quantified(word, parameters, body):
                each = [self.truth(body, {**binding, **m}) for m in self.bindings(parameters)]
                if word == "forall":
                    return lambda state: min([part(state) for part in each], default=1)
                return lambda state: max([part(state) for part in each], default=0)

    def value(self, expression, binding):
        """The value of a numeric expression; NaN where it has none: by zero, of an infinity."""
        match expression:
            case x.Number(value):
                return lambda state: value
            case x.FunctionTerm():
                key = ground(expression, binding)
                return lambda state: float(state[key])
            case x.TotalTime():
                return lambda state: state[TIME]
            case x.Arithmetic(symbol, operands):
                parts = [self.value(operand, binding) for operand in operands]
                if len(parts) == 1:
                    of_one, part = OF_ONE[symbol], parts[0]
                    return lambda state: of_one(part(state))
                combined = ARITHMETIC[symbol]
                return lambda state: functools.reduce(combined, [part(state) for part in parts])


def bound(term, binding):
    """The object that a term stands for."""
    return binding[term.name] if term.name.startswith("?") else term.name


def ground(term, binding):
    """The ground term under a binding."""
    if not term.arguments:
        return (term.name,)
    return (term.name, *[bound(argument, binding) for argument in term.arguments])


def quotient(dividend, divisor):
    """Divide; NaN by zero."""
    return dividend / divisor if divisor != 0.0 else math.nan


def root(value):
    """Return a square root; NaN of a negative number."""
    return math.sqrt(value) if value >= 0.0 else math.nan


def wave(function):
    """Return a sine or cosine that is NaN where there is no angle."""
    return lambda angle: function(angle) if math.isfinite(angle) else math.nan


def extreme(better):
    """Return the lesser or greater of two, the second of equal ones; NaN where one is NaN."""
    return lambda one, other: one if math.isnan(one) or better(one, other) else other


def is_empty(condition):
    """Whether a condition asks for nothing: `(and)`, `(and (and))`."""
    return (
        isinstance(condition, x.Connective)
        and condition.operator == "and"
        and all(is_empty(operand) for operand in condition.operands)
    )


def refuse_contradictions(numbers):
    """Changes of one number contradict each other unless they commute.

    Increases and decreases do, scalings do, and so do assignments of one and the same value.
    """
    for key in {key for _, key, _ in numbers}:
        changes = {change for change, other, _ in numbers if other == key}
        assigned = {value for change, other, value in numbers if (change, other) == (A, key)}
        if not (changes <= ADDITIVE or changes <= SCALING or changes == {A}) or len(assigned) > 1:
            raise NotApplicable


A = x.Change.ASSIGN
ADDITIVE = {x.Change.INCREASE, x.Change.DECREASE}
SCALING = {x.Change.SCALE_UP, x.Change.SCALE_DOWN}
CHANGES = {
    x.Change.ASSIGN: lambda old, value: value,
    x.Change.INCREASE: operator.add,
    x.Change.DECREASE: operator.sub,
    x.Change.SCALE_UP: operator.mul,
    x.Change.SCALE_DOWN: quotient,
}
OF_ONE = {
    **{"-": operator.neg, "abs": abs, "sqrt": root},
    **{"sin": wave(math.sin), "cos": wave(math.cos)},
}
ARITHMETIC = {
    **{"+": operator.add, "-": operator.sub, "*": operator.mul, "/": quotient},
    **{"min": extreme(operator.lt), "max": extreme(operator.gt), "atan2": math.atan2},
}
COMPARISONS = {
    **{"<": operator.lt, "<=": operator.le, "=": operator.eq},
    **{">=": operator.ge, ">": operator.gt},
}
