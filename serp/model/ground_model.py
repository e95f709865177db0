"""The ground model: fluents, parameters, and ground actions, processes and events.

All names are resolved to positions: a fluent is a column of the state, a number of the files is an
entry of the parameter vector θ.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

from serp.pddl.source import Place
from serp.pddl.syntax import Change, DomainSyntax, Kind, nodes_in

REWARD_TARGET = -1
UNSAFE_TARGET = -2
TERMINAL_TARGET = -3


@dataclass(frozen=True, slots=True)
class Fluent:
    """One column of a state.

    Attributes:
        name: Printable name without parentheses: `pole-angle`, `at robot1 kitchen`.
        index: The column.
        numeric: False for a predicate, whose value is 0 or 1.
        symbol: Name of the declared predicate or function.
        arguments: The objects.
    """

    name: str
    index: int
    numeric: bool
    symbol: str
    arguments: tuple[str, ...]

    @property
    def key(self) -> tuple[str, ...]:
        """The symbol and the objects."""
        return (self.symbol, *self.arguments)


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of the files, an entry of θ.

    Attributes:
        index: Position in θ.
        value: What is written in the file.
        role: `effect`, `rate`, `condition`, `initial` (a static value of the problem), `metric`, or
            `goal`: the reward for reaching the goal, which follows from the others.
        place: Where it is written; for `goal` the place of the metric.
    """

    index: int
    value: float
    role: str
    place: Place


# Numeric expressions ---------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Read:
    """The value of a fluent."""

    fluent: int


@dataclass(frozen=True, slots=True)
class ParameterRef:
    """An entry of θ."""

    parameter: int


@dataclass(frozen=True, slots=True)
class Operation:
    """`operator` is one of + - * / min max atan2."""

    operator: str
    left: Value
    right: Value


@dataclass(frozen=True, slots=True)
class Unary:
    """`operator` is one of - abs sqrt sin cos."""

    operator: str
    operand: Value


@dataclass(frozen=True, slots=True)
class Elapsed:
    """The control period Δt, in a metric with `(total-time)`."""


Value = Read | ParameterRef | Operation | Unary | Elapsed

# Conditions ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Constant:
    """Always true or always false."""

    value: bool


@dataclass(frozen=True, slots=True)
class Holds:
    """A predicate is true; `fluent` may be UNSAFE_TARGET or TERMINAL_TARGET."""

    fluent: int
    place: Place


@dataclass(frozen=True, slots=True)
class Compare:
    """`operator` is one of < <= = >= >."""

    operator: str
    left: Value
    right: Value
    place: Place


@dataclass(frozen=True, slots=True)
class Not:
    """Negation."""

    operand: Test
    place: Place


@dataclass(frozen=True, slots=True)
class All:
    """Conjunction of two or more tests."""

    operands: tuple[Test, ...]
    place: Place


@dataclass(frozen=True, slots=True)
class AnyOf:
    """Disjunction of two or more tests."""

    operands: tuple[Test, ...]
    place: Place


Test = Constant | Holds | Compare | Not | All | AnyOf

# Effects ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SetBoolean:
    """Makes a predicate (a fluent, UNSAFE_TARGET or TERMINAL_TARGET) true or false."""

    target: int
    value: bool
    condition: Test
    place: Place


@dataclass(frozen=True, slots=True)
class SetNumber:
    """Changes a numeric fluent or REWARD_TARGET; in a process `value` is a rate."""

    target: int
    change: Change
    value: Value
    condition: Test
    place: Place


GroundEffect = SetBoolean | SetNumber


@dataclass(frozen=True, slots=True)
class GroundOutcome:
    """What happens with a probability in (0, 1) in place of the likeliest effects of an action."""

    probability: float
    effects: tuple[GroundEffect, ...]


@dataclass(frozen=True, slots=True)
class GroundSchema:
    """A ground action, process or event.

    Attributes:
        kind: Which of the three.
        name: Printable name: `push-left`, `move robot1 kitchen`.
        schema: Name of the schema.
        arguments: The objects bound to its parameters.
        preconditions: The conjuncts of the precondition, constants removed.
        effects: Effects whose condition can hold; of an action with chance the likeliest ones.
        place: Where the schema is defined.
        outcomes: What may happen in place of the effects, the likeliest first.
    """

    kind: Kind
    name: str
    schema: str
    arguments: tuple[str, ...]
    preconditions: tuple[Test, ...]
    effects: tuple[GroundEffect, ...]
    place: Place
    outcomes: tuple[GroundOutcome, ...] = ()

    @property
    def possible_effects(self) -> tuple[GroundEffect, ...]:
        """The effects of all outcomes."""
        return (*self.effects, *(effect for of in self.outcomes for effect in of.effects))

    def as_outcome(self, number: int) -> GroundSchema:
        """Return the schema with the effects of an outcome; those of number 0 are its own."""
        if not self.outcomes:
            return self
        effects = self.outcomes[number - 1].effects if number else self.effects
        return replace(self, effects=effects, outcomes=())


@dataclass(frozen=True)
class GroundMetric:
    """The problem's metric where it is not `(reward)`: its change, signed, is the reward."""

    maximize: bool
    value: Value
    place: Place


@dataclass(frozen=True)
class GroundModel:
    """Everything that the transition model is compiled from.

    Attributes:
        syntax: The domain as written.
        fluents: The columns of a state.
        parameters: The entries of θ.
        actions, processes, events: The ground schemas, in file order.
        goal: The problem's goal; None where there is none.
        goal_rewarded: Whether reaching the goal is a reward: the files declare no `(reward)`.
        goal_parameter: The entry of θ that is that reward: the file's, or in a problem with a
            metric what `serp.model.grounder` says; None: it is 1.
        metric: The problem's metric, where it is not `(reward)`.
        initial: The value of every fluent; None where the problem leaves a number out.
        static: Printable name → value of everything that the problem states and no effect changes.
    """

    syntax: DomainSyntax = field(repr=False, compare=False)
    fluents: tuple[Fluent, ...]
    parameters: tuple[Parameter, ...]
    actions: tuple[GroundSchema, ...]
    processes: tuple[GroundSchema, ...]
    events: tuple[GroundSchema, ...]
    goal: Test | None
    goal_rewarded: bool
    goal_parameter: int | None
    metric: GroundMetric | None
    initial: tuple[float, ...] | None
    static: dict[str, float]

    @property
    def schemas(self) -> tuple[GroundSchema, ...]:
        """The ground actions, processes and events."""
        return (*self.actions, *self.processes, *self.events)

    @functools.cached_property
    def fluents_of_objects(self) -> dict[str, list[Fluent]]:
        """Object → the fluents with it; the empty name → those without objects."""
        of_object: dict[str, list[Fluent]] = {}
        for fluent in self.fluents:
            for thing in set(fluent.arguments) or ("",):
                of_object.setdefault(thing, []).append(fluent)
        return of_object

    @functools.cached_property
    def numeric_tuples(self) -> dict[tuple[str, ...], list[Fluent]]:
        """Objects → all fluents of exactly these, where one of them is a number."""
        tuples: dict[tuple[str, ...], list[Fluent]] = {}
        for fluent in self.fluents:
            tuples.setdefault(fluent.arguments, []).append(fluent)
        return {o: fluents for o, fluents in tuples.items() if any(f.numeric for f in fluents)}


def fluents_of(*parts: object) -> Iterator[int]:
    """Yield the index of every fluent (or flag target) that tests, values or effects read."""
    return (node.fluent for node in nodes_in(*parts) if isinstance(node, Read | Holds))


def comparisons_of(*parts: object) -> Iterator[Compare]:
    """Yield every comparison of numbers in tests or effects."""
    return (node for node in nodes_in(*parts) if isinstance(node, Compare))


def sets(effect: GroundEffect, flag: int) -> bool:
    """Whether an effect sets a flag: UNSAFE_TARGET or TERMINAL_TARGET."""
    return isinstance(effect, SetBoolean) and effect.target == flag and effect.value


def flagging(schema: GroundSchema, flag: int) -> list[tuple[Test, ...]]:
    """Return when a schema sets a flag: for each effect that does, what has to hold together.

    For an action this is beyond its precondition, without which nothing happens.
    """
    own = () if schema.kind is Kind.ACTION else schema.preconditions
    return [(*own, e.condition) for e in schema.possible_effects if sets(e, flag)]


def reads(schema: GroundSchema) -> set[int]:
    """Return every fluent that the precondition or the effects read."""
    return set(fluents_of(schema.preconditions, schema.possible_effects))


def writes(schema: GroundSchema) -> set[int]:
    """Return every fluent and flag target that the effects change."""
    return {effect.target for effect in schema.possible_effects}


FUNCTIONS: Mapping[str, Callable[..., float]] = {
    **{"sqrt": math.sqrt, "sin": math.sin, "cos": math.cos, "atan2": math.atan2},
    **{"abs": abs, "min": min, "max": max},
}
ELAPSED = "elapsed"
"""The atom of the control period."""


@dataclass(frozen=True)
class Linear:
    """A sum of atoms, each times a factor, and a constant.

    An atom is the column of a fluent, ELAPSED, or an operation that is not linear: a tuple of its
    operator and the keys of its operands.
    """

    terms: dict[Hashable, Fraction]
    constant: Fraction

    def plus(self, other: Linear, factor: Fraction) -> Linear:
        """Return this sum plus another one times a factor."""
        terms = dict(self.terms)
        for atom, k in other.terms.items():
            total = terms.get(atom, Fraction(0)) + k * factor
            if total:
                terms[atom] = total
            else:
                terms.pop(atom, None)
        return Linear(terms, self.constant + other.constant * factor)

    @property
    def key(self) -> Hashable:
        """Equal for equal sums."""
        return frozenset(self.terms.items()), self.constant


_NOTHING = Linear({}, Fraction(0))


def linear(value: Value, theta: Sequence[float]) -> Linear:
    """Return a numeric expression as a sum, for given parameters."""
    match value:
        case Read(fluent):
            return Linear({fluent: Fraction(1)}, Fraction(0))
        case ParameterRef(parameter):
            return Linear({}, Fraction(repr(float(theta[parameter]))))  # as it is written
        case Unary("-", operand):
            return _NOTHING.plus(linear(operand, theta), Fraction(-1))
        case Elapsed():
            return Linear({ELAPSED: Fraction(1)}, Fraction(0))
        case Unary(operator, operand):
            return _applied(operator, linear(operand, theta))
        case Operation(operator, left, right):
            one, other = linear(left, theta), linear(right, theta)
            if operator in FUNCTIONS:
                return _applied(operator, one, other)
            if operator in "+-":
                return one.plus(other, Fraction(1 if operator == "+" else -1))
            if not other.terms and (operator == "*" or other.constant):
                factor = other.constant
                return _NOTHING.plus(one, factor if operator == "*" else 1 / factor)
            if operator == "*" and not one.terms:
                return _NOTHING.plus(other, one.constant)
            return _applied(operator, one, other)


def _applied(operator: str, *operands: Linear) -> Linear:
    """Return an operation as one atom, or as its value where nothing varies."""
    if operator in FUNCTIONS and not any(operand.terms for operand in operands):
        try:
            value = FUNCTIONS[operator](*(float(operand.constant) for operand in operands))
            return Linear({}, Fraction(repr(value)))
        except (ValueError, OverflowError):  # it has no result
            pass
    return Linear({(operator, *(operand.key for operand in operands)): Fraction(1)}, Fraction(0))
