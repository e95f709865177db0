"""The abstract syntax of a domain and a problem as written, before instantiation.

Every node keeps its place in the file, so that later messages, explanations and corrections can
point at it. Names follow PDDL 2.1 (Fox & Long, 2003) and PDDL+ (Fox & Long, 2006).
"""

from __future__ import annotations

import functools
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

from serp.pddl.source import Place

REWARD = "reward"
UNSAFE = "unsafe"
TERMINAL = "terminal"
OBJECT = "object"

MATH_REQUIREMENT = ":math-functions"
"""The requirement that admits functions which PDDL does not have."""
MATH_FUNCTIONS: dict[str, tuple[int, int | None]] = {
    **dict.fromkeys(("sqrt", "abs", "sin", "cos"), (1, 1)),
    "atan2": (2, 2),
    **dict.fromkeys(("min", "max"), (2, None)),
}
"""Name → least and most operands (None: any number)."""
OPERATORS: dict[str, tuple[int, int | None]] = {
    **{"+": (2, None), "-": (1, 2), "*": (2, None), "/": (2, 2)},
    **MATH_FUNCTIONS,
}
"""Everything that an `Arithmetic` may apply."""


@dataclass(frozen=True, slots=True)
class SchemaParameter:
    """A typed variable; `types` holds more than one name only for `(either ...)`."""

    name: str
    types: tuple[str, ...]
    place: Place


@dataclass(frozen=True, slots=True)
class SchemaTerm:
    """An argument: a variable (`?x`) or the name of an object."""

    name: str
    place: Place

    @property
    def is_variable(self) -> bool:
        """Whether the term starts with `?`."""
        return self.name.startswith("?")


# Numeric expressions ---------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Number:
    """A literal."""

    value: float
    place: Place


@dataclass(frozen=True, slots=True)
class FunctionTerm:
    """The value of a numeric fluent."""

    name: str
    arguments: tuple[SchemaTerm, ...]
    place: Place


@dataclass(frozen=True, slots=True)
class Arithmetic:
    """`operator` is one of OPERATORS; a single operand under `-` is a negation."""

    operator: str
    operands: tuple[Expression, ...]
    place: Place


@dataclass(frozen=True, slots=True)
class TotalTime:
    """`(total-time)`, in a metric only."""

    place: Place


Expression = Number | FunctionTerm | Arithmetic | TotalTime

# Conditions ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Atom:
    """A predicate applied to terms."""

    name: str
    arguments: tuple[SchemaTerm, ...]
    place: Place


@dataclass(frozen=True, slots=True)
class SameObject:
    """`(= a b)` over objects."""

    left: SchemaTerm
    right: SchemaTerm
    place: Place


@dataclass(frozen=True, slots=True)
class NumericComparison:
    """`operator` is one of < <= = >= >."""

    operator: str
    left: Expression
    right: Expression
    place: Place


@dataclass(frozen=True, slots=True)
class Connective:
    """`operator` is `and`, `or`, `not` (one operand) or `imply` (two)."""

    operator: str
    operands: tuple[Condition, ...]
    place: Place


@dataclass(frozen=True, slots=True)
class Quantified:
    """`operator` is `forall` or `exists`."""

    operator: str
    parameters: tuple[SchemaParameter, ...]
    body: Condition
    place: Place


Condition = Atom | SameObject | NumericComparison | Connective | Quantified

# Effects ---------------------------------------------------------------------------------------


class Change(Enum):
    """How a numeric effect changes its fluent."""

    ASSIGN = "assign"
    INCREASE = "increase"
    DECREASE = "decrease"
    SCALE_UP = "scale-up"
    SCALE_DOWN = "scale-down"

    @property
    def group(self) -> str:
        """`assign`, `add` or `scale`: additions commute, and so do scalings."""
        if self is Change.ASSIGN:
            return "assign"
        return "add" if self in (Change.INCREASE, Change.DECREASE) else "scale"


@dataclass(frozen=True, slots=True)
class SetPredicate:
    """Makes a predicate true or false."""

    atom: Atom
    value: bool
    place: Place


@dataclass(frozen=True, slots=True)
class ChangeFunction:
    """Changes a numeric fluent. In a process, `value` is the rate (the factor beside `#t`)."""

    change: Change
    function: FunctionTerm
    value: Expression
    place: Place


@dataclass(frozen=True, slots=True)
class When:
    """A conditional effect; nesting is refused by the parser."""

    condition: Condition
    effects: tuple[Effect, ...]
    place: Place


@dataclass(frozen=True, slots=True)
class ForallEffect:
    """An effect for every binding of the parameters."""

    parameters: tuple[SchemaParameter, ...]
    effects: tuple[Effect, ...]
    place: Place


@dataclass(frozen=True, slots=True)
class ChanceOutcome:
    """Effects that happen with a probability in (0, 1]."""

    probability: float
    effects: tuple[Effect, ...]
    place: Place


@dataclass(frozen=True, slots=True)
class Chance:
    """`(probabilistic p effect ...)` (PPDDL 1.0, Younes & Littman 2004) or `(oneof effect ...)`.

    At most one outcome happens; with the rest of the probability there is none.
    """

    outcomes: tuple[ChanceOutcome, ...]
    place: Place


Effect = SetPredicate | ChangeFunction | When | ForallEffect | Chance

# Definitions -----------------------------------------------------------------------------------


class Kind(Enum):
    """What a schema describes."""

    ACTION = "action"
    PROCESS = "process"
    EVENT = "event"


@dataclass(frozen=True, slots=True)
class Schema:
    """An `(:action ...)`, `(:process ...)` or `(:event ...)` as written."""

    kind: Kind
    name: str
    parameters: tuple[SchemaParameter, ...]
    precondition: Condition
    effects: tuple[Effect, ...]
    place: Place


@dataclass(frozen=True, slots=True)
class Axiom:
    """`(:derived (name parameters) condition)`: the predicate holds where a condition does.

    A derived predicate holds where the condition of one of its axioms does, and nowhere else.
    """

    name: str
    parameters: tuple[SchemaParameter, ...]
    condition: Condition
    place: Place


@dataclass(frozen=True, slots=True)
class Declaration:
    """A declared predicate (`numeric` False) or function (`numeric` True)."""

    name: str
    parameters: tuple[SchemaParameter, ...]
    numeric: bool
    place: Place

    @property
    def reserved(self) -> bool:
        """Whether it is `(reward)`, `(unsafe)` or `(terminal)`; no name is with parameters."""
        return self.name in (REWARD, UNSAFE, TERMINAL) and not self.parameters


@dataclass(frozen=True, slots=True)
class ObjectDeclaration:
    """A constant of the domain or an object of the problem."""

    name: str
    type: str
    place: Place


def is_subtype(type_name: str, ancestor: str, parents: Mapping[str, str]) -> bool:
    """Whether a type is the ancestor or below it."""
    while type_name != ancestor and type_name in parents:
        type_name = parents[type_name]
    return ancestor in (type_name, OBJECT)


@dataclass(frozen=True)
class DomainSyntax:
    """A parsed domain file."""

    name: str
    parents: dict[str, str]
    """Type → its parent; the root `object` is not a key."""
    constants: dict[str, ObjectDeclaration]
    declarations: dict[str, Declaration]
    """Predicates and functions by name, in file order."""
    schemas: tuple[Schema, ...]
    axioms: tuple[Axiom, ...]
    requirements: frozenset[str]
    place: Place

    @functools.cached_property
    def derived(self) -> frozenset[str]:
        """The predicates that axioms define."""
        return frozenset(axiom.name for axiom in self.axioms)

    def admits(self, parameter: SchemaParameter, type_name: str) -> bool:
        """Whether a parameter may be an object of a type."""
        return any(is_subtype(type_name, wanted, self.parents) for wanted in parameter.types)


@dataclass(frozen=True)
class Metric:
    """`(:metric maximize|minimize expression)`."""

    maximize: bool
    expression: Expression
    place: Place


@dataclass(frozen=True)
class ProblemSyntax:
    """A parsed problem file."""

    name: str
    objects: dict[str, ObjectDeclaration]
    true_atoms: tuple[Atom, ...]
    values: tuple[tuple[FunctionTerm, Number], ...]
    goal: Condition | None
    goal_reward: Number | None
    """The reward for reaching the goal (PPDDL); None: 1, or what the metric says."""
    metric: Metric | None
    place: Place
    init: Place | None
    """The `:init`; what it does not state is false."""

    @property
    def has_init(self) -> bool:
        """Whether there is an `:init`."""
        return self.init is not None


# Walks -----------------------------------------------------------------------------------------


def nodes_in(*parts: object) -> Iterator[object]:
    """Yield the nodes of some parts of a file, each before those in it, in their order."""
    waiting: list[Any] = [*reversed(parts)]
    while waiting:
        part = waiting.pop()
        if part.__class__ is tuple:
            waiting += reversed(part)
        elif (names := _fields_of(part.__class__)) is not None:
            yield part
            waiting += [getattr(part, name) for name in reversed(names)]


def meaning(part: Any) -> Hashable:
    """Return what a part of a file says, without its places; equal for what says the same."""
    if part.__class__ is tuple:
        return tuple(map(meaning, part))
    if (names := _fields_of(part.__class__)) is not None:
        return type(part), *(meaning(getattr(part, name)) for name in names)
    return None if isinstance(part, Place) else part


@functools.cache
def _fields_of(kind: type) -> tuple[str, ...] | None:
    """Return the fields of a kind of node, but for its place; None for what is no node."""
    names = None if kind is Place else getattr(kind, "__match_args__", None)
    return names and tuple(name for name in names if name != "place")


def names_in(*parts: object) -> set[str]:
    """Return the predicates and functions that parts of a file name."""
    return {node.name for node in nodes_in(*parts) if isinstance(node, Atom | FunctionTerm)}


def changed_names(*effects: object) -> set[str]:
    """Return the predicates and functions that effects change."""
    changes = [*nodes_in(*effects)]
    return {
        *(node.atom.name for node in changes if isinstance(node, SetPredicate)),
        *(node.function.name for node in changes if isinstance(node, ChangeFunction)),
    }
