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
        return {
            " ".join((schema.name, *binding.values())): (schema, binding)
            for schema in self.domain.schemas
            if schema.kind is kind
            for binding in self.bindings(schema.parameters)
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
        reached = goal is not None and not is_empty(goal) and self.holds(goal, state, {})
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
        late = self.value(metric.expression, after, {}, total_time=dt)
        early = self.value(metric.expression, before, {}, total_time=0.0)
        return late - early if metric.maximize else early - late

    def enabled(self, schema, state, binding):
        """Whether the precondition holds."""
        return self.holds(schema.precondition, state, binding)

    # Effects -----------------------------------------------------------------------------------

    def changed(self, state, together, rate_time=None):
        """Apply the effects of some schemas together: all are evaluated before any is applied."""
        deletes = []
        adds = []
        numbers = []
        for schema, binding in together:
            for effect, bound in self.active(schema.effects, state, binding):
                if isinstance(effect, x.SetPredicate):
                    (adds if effect.value else deletes).append(ground(effect.atom, bound))
                else:
                    value = self.value(effect.value, state, bound)
                    if rate_time is not None:
                        value = rate_time * value
                    numbers.append((effect.change, ground(effect.function, bound), value))
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

    def active(self, effects, state, binding):
        """The simple effects that happen in a state."""
        for effect in effects:
            match effect:
                case x.When(condition, inner):
                    if self.holds(condition, state, binding):
                        yield from self.active(inner, state, binding)
                case x.ForallEffect(parameters, inner):
                    for more in self.bindings(parameters):
                        yield from self.active(inner, state, {**binding, **more})
                case x.SetPredicate() | x.ChangeFunction():
                    yield effect, binding

    # Conditions and values ---------------------------------------------------------------------

    def holds(self, condition, state, binding):
        """Whether a condition is true in a state; one that is undefined ends the step."""
        truth = self.truth(condition, state, binding)
        if truth == UNKNOWN:
            raise NotApplicable
        return truth == 1

    def truth(self, condition, state, binding):
        """1 (true), 0 (false) or UNKNOWN, where it depends on a number that is NaN (Kleene)."""
        match condition:
            case x.Atom():
                return bool(state[ground(condition, binding)])
            case x.SameObject(left, right):
                return bound(left, binding) == bound(right, binding)
            case x.NumericComparison(symbol, left_side, right_side):
                left_value = self.value(left_side, state, binding)
                right_value = self.value(right_side, state, binding)
                if math.isnan(left_value) or math.isnan(right_value):
                    return UNKNOWN
                return COMPARISONS[symbol](left_value, right_value)
            case x.Connective(word, operands):
                truths = [self.truth(operand, state, binding) for operand in operands]
                match word:
                    case "and":
                        return min(truths, default=1)
                    case "or":
                        return max(truths, default=0)
                    case "not":
                        return 1 - truths[0]
                    case _:  # imply
                        return max(1 - truths[0], truths[1])
            case x.Quantified(word, parameters, body):
                bindings = ({**binding, **more} for more in self.bindings(parameters))
                truths = [self.truth(body, state, inner) for inner in bindings]
                return min(truths, default=1) if word == "forall" else max(truths, default=0)

    def value(self, expression, state, binding, total_time=0.0):
        """The value of a numeric expression; NaN where it has none: by zero, of an infinity."""
        match expression:
            case x.Number(value):
                return value
            case x.FunctionTerm():
                return float(state[ground(expression, binding)])
            case x.TotalTime():
                return total_time
            case x.Arithmetic(symbol, operands):
                values = [self.value(o, state, binding, total_time) for o in operands]
                if len(values) == 1:
                    return OF_ONE[symbol](values[0])
                return functools.reduce(ARITHMETIC[symbol], values)


def bound(term, binding):
    """The object that a term stands for."""
    return binding[term.name] if term.name.startswith("?") else term.name


def ground(term, binding):
    """The ground term under a binding."""
    return (term.name, *(bound(argument, binding) for argument in term.arguments))


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
