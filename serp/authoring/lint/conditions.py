"""Rules: conditions that never hold or always hold, and actions that are never safe."""

from __future__ import annotations

import math
import operator as op
import re
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import combinations

from serp.authoring.lint.subject import LintSubject
from serp.model import ground as g
from serp.model.ground import UNSAFE_TARGET, Linear, linear
from serp.pddl.source import DomainWarning, Edit, Fix, Place
from serp.pddl.syntax import Kind

Pair = tuple[g.Test, g.Test]
_HOLDS = {"<": op.lt, "<=": op.le, "=": op.eq, "!=": op.ne, ">=": op.ge, ">": op.gt}
_MIRRORED = {"<": ">", "<=": ">=", "=": "=", ">=": "<=", ">": "<"}
_NEGATED = {"<": ">=", "<=": ">", ">=": "<", ">": "<="}
_RANGES = {
    **dict.fromkeys(("sqrt", "abs"), (0.0, math.inf)),
    **dict.fromkeys(("sin", "cos"), (-1.0, 1.0)),
    "atan2": (-3.1416, 3.1416),
}
"""What functions cannot leave; π is rounded up."""
_MOST_ALTERNATIVES = 32
"""Alternatives of a disjunction that are tried."""


def contradiction(tests: Iterable[g.Test], theta: Sequence[float]) -> Pair | None:
    """Return two tests that cannot hold together, or None where none are found.

    Both are the same where one test contradicts itself.
    """
    known = _Known(theta)
    later: list[g.AnyOf] = []
    for test in tests:
        if pair := known.add(test, later):
            return pair
    for alternatives in later:
        if len(alternatives.operands) <= _MOST_ALTERNATIVES:
            pairs = [known.copy().add(operand, []) for operand in alternatives.operands]
            if all(pairs):
                return next((p for p in pairs if p and p[0] != p[1]), pairs[0])
    return None


def threshold(test: g.Compare, theta: Sequence[float]) -> tuple[int, str, float] | None:
    """Return fluent, operator and number of a comparison that puts a limit to one fluent.

    The operator is the one between them in this order. None for any other comparison.
    """
    form = _difference(test, theta)
    if len(form.terms) == 1:
        ((atom, factor),) = form.terms.items()
        if isinstance(atom, int):
            operator = test.operator if factor > 0 else _MIRRORED[test.operator]
            return atom, operator, float(-form.constant / factor)
    return None


@dataclass
class _Bounds:
    """The bounds of an expression, with the tests that they come from."""

    low: tuple[Fraction | float, bool, g.Test] | None = None  # value, whether strict, test
    high: tuple[Fraction | float, bool, g.Test] | None = None
    excluded: dict[Fraction | float, g.Test] = field(default_factory=dict)

    def add(self, operator: str, value: Fraction | float, test: g.Test) -> Pair | None:
        if operator == "!=":
            self.excluded[value] = test
        if operator in (">", ">=", "="):
            new = (value, operator == ">", test)
            if self.low is None or new[:2] > self.low[:2]:
                self.low = new
        if operator in ("<", "<=", "="):
            new = (value, operator == "<", test)
            if self.high is None or (-value, new[1]) > (-self.high[0], self.high[1]):
                self.high = new
        if self.low is None or self.high is None:
            return None
        if self.low[0] > self.high[0]:
            return self.low[2], self.high[2]
        if self.low[0] == self.high[0]:
            if self.low[1] or self.high[1]:
                return self.low[2], self.high[2]
            if self.low[0] in self.excluded:
                return self.low[2], self.excluded[self.low[0]]
        return None


class _Known:
    """What a conjunction implies for predicates and expressions."""

    def __init__(self, theta: Sequence[float]) -> None:
        self.theta = theta
        self.truths: dict[int, tuple[bool, g.Test]] = {}
        self.bounds: dict[Hashable, _Bounds] = {}

    def copy(self) -> _Known:
        other = _Known(self.theta)
        other.truths = dict(self.truths)
        other.bounds = {
            key: _Bounds(b.low, b.high, dict(b.excluded)) for key, b in self.bounds.items()
        }
        return other

    def add(
        self,
        test: g.Test,
        later: list[g.AnyOf],
        *,
        holds: bool = True,
        written: g.Test | None = None,
    ) -> Pair | None:
        """Add a test, or its negation; return what excludes each other.

        `later` takes the disjunctions; `written` is the test as the file has it.
        """
        written = test if written is None else written
        match test:
            case g.Constant(value):
                return (written, written) if value != holds else None
            case g.Not(operand):
                return self.add(operand, later, holds=not holds, written=written)
            case g.Holds(fluent):
                known = self.truths.setdefault(fluent, (holds, written))
                return (known[1], written) if known[0] != holds else None
            case g.Compare():
                return self._compare(test, written, holds=holds)
            case g.All(operands) | g.AnyOf(operands) if isinstance(test, g.All) == holds:
                pairs = (self.add(operand, later, holds=holds) for operand in operands)
                return next((pair for pair in pairs if pair), None)
            case g.All(operands) | g.AnyOf(operands):
                if not holds:
                    operands = tuple(g.Not(operand, test.place) for operand in operands)
                later.append(g.AnyOf(operands, test.place))
                return None

    def _compare(self, test: g.Compare, written: g.Test, *, holds: bool) -> Pair | None:
        operator = test.operator if holds else _NEGATED.get(test.operator, "!=")
        form = _difference(test, self.theta)
        if not form.terms:
            return None if _HOLDS[operator](form.constant, 0) else (written, written)
        first = min(form.terms, key=repr)
        factor = form.terms[first]
        key = frozenset((atom, k / factor) for atom, k in form.terms.items())
        if factor < 0:
            operator = _MIRRORED.get(operator, operator)
        value = -form.constant / factor
        if len(key) == 1 and isinstance(first, tuple) and first[0] in _RANGES:
            reachable = _Bounds()
            for end, bound in zip((">=", "<="), _RANGES[first[0]], strict=True):
                reachable.add(end, bound, written)
            if reachable.add(operator, value, written):
                return written, written
        return self.bounds.setdefault(key, _Bounds()).add(operator, value, written)


def _difference(test: g.Compare, theta: Sequence[float]) -> Linear:
    return linear(test.left, theta).plus(linear(test.right, theta), Fraction(-1))


# Rules -------------------------------------------------------------------------------------------

_BEYOND = {"<": ">", "<=": ">", ">": "<", ">=": "<"}
"""Comparison → what holds where it does not hold, but for one number."""
_MOST_OPERANDS = 40
"""Operands of one list that are compared with one another."""
_POSITIVE = re.compile(r"\s(\d[\d.]*)\s*\)\Z")
_CANNOT = {
    Kind.ACTION: "can never be applied",
    Kind.PROCESS: "can never run",
    Kind.EVENT: "can never fire",
}


def _always_true(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find comparisons that hold in every state, alone or with another one of the same `or`."""
    for what, schemas in _possible(subject):
        # None where it does not hold in every instance.
        always: dict[tuple[Place, ...], DomainWarning | None] = {}
        for schema in schemas:
            effects = dict.fromkeys(effect.condition for effect in schema.effects)
            undecided = [
                (places, compared)
                for condition in (*schema.preconditions, *effects)
                for test in _parts(condition)
                for compared in _candidates(test, subject)
                if always.get(places := tuple(one.place for one in compared), True)
            ]
            if undecided and not contradiction(schema.preconditions, subject.theta):
                for places, compared in undecided:
                    warning = _tautology(compared, what, subject)
                    always[places] = always.get(places, warning) and warning
        yield from filter(None, always.values())


def _candidates(test: g.Test, subject: LintSubject) -> Iterator[tuple[g.Compare, ...]]:
    """Yield a comparison alone, and the pairs of those in an `or` that no problem changes."""
    if isinstance(test, g.Compare):
        yield (test,)
    elif isinstance(test, g.AnyOf):
        comparisons = [
            operand
            for operand in test.operands[:_MOST_OPERANDS]
            if isinstance(operand, g.Compare)
            and operand.operator in _BEYOND
            and not _depends_on_problem(operand, subject.anywhere)
            and not any(operand.place.within(place) for place in subject.quantified)
        ]
        yield from combinations(comparisons, 2)


def _tautology(
    compared: tuple[g.Compare, ...], what: str, subject: LintSubject
) -> DomainWarning | None:
    """Return a warning if a comparison, or one of two, holds in every state."""
    first, second = compared[0], compared[-1]
    if len(compared) == 1:
        always = not _depends_on_problem(first, subject.anywhere) and contradiction(
            (g.Not(first, first.place),), subject.theta
        )
        text = f"`{first.place.text}` in {what} always holds"
        return DomainWarning(text, first.place) if always else None
    neither = [replace(one, operator=_BEYOND[one.operator]) for one in compared]
    pair = contradiction(neither, subject.theta)
    if not pair or pair[0] == pair[1]:
        return None
    fix = _with_minus(second.place)
    return DomainWarning(
        f"`{first.place.text}` or `{second.place.text}` always holds in {what}",
        second.place,
        advice="is a minus missing?" if fix else "",
        fix=fix,
    )


def _parts(test: g.Test) -> Iterator[g.Test]:
    """Yield a condition and those in it."""
    yield test
    if isinstance(test, g.All | g.AnyOf):
        for operand in test.operands:
            yield from _parts(operand)
    elif isinstance(test, g.Not):
        yield from _parts(test.operand)


def _depends_on_problem(test: g.Compare, ground: g.GroundModel) -> bool:
    """Whether a test compares with a number that another problem may give otherwise."""
    values: list[g.Value] = [test.left, test.right]
    while values:
        match values.pop():
            case g.ParameterRef(parameter) if ground.parameters[parameter].role == "initial":
                return True
            case g.Operation(_, left, right):
                values += left, right
            case g.Unary(_, operand):
                values.append(operand)
    return False


def _with_minus(place: Place) -> Fix | None:
    """Return the guess that the number at the end of a comparison should be negative."""
    number = _POSITIVE.search(place.source.text, place.start, place.end)
    if number is None:
        return None
    return Fix((Edit(number.start(1), number.start(1), "-"),), sure=False)


def _contradictory(subject: LintSubject) -> Iterator[DomainWarning]:
    for name, schemas in subject.telling.items():
        if pair := _contradiction_in_all(subject, schemas):
            kind, place = schemas[0].kind, schemas[0].place.opening
            yield _exclusion(f"{kind.value} `{name}` {_CANNOT[kind]}", pair, place)


def _always_unsafe(subject: LintSubject) -> Iterator[DomainWarning]:
    for what, schemas in _possible(subject):
        kind, place = schemas[0].kind, schemas[0].place.opening
        theta = subject.theta
        if kind is Kind.ACTION and all(_unsafe(action, theta) for action in schemas):
            yield DomainWarning(
                f"{what} is unsafe wherever it can be applied: it is executed only where every "
                "other action is unsafe too",
                place,
            )
        if kind is Kind.EVENT and any(
            _always_fires(event, theta) and _unsafe(event, theta) for event in schemas
        ):
            yield DomainWarning(f"{what} makes every action unsafe: it always fires", place)


def _possible(subject: LintSubject) -> Iterator[tuple[str, list[g.GroundSchema]]]:
    """Yield kind with name, and instances, of the schemas that can happen."""
    for name, schemas in subject.telling.items():
        if not _contradiction_in_all(subject, schemas):
            yield f"{schemas[0].kind.value} `{name}`", schemas


def _contradiction_in_all(subject: LintSubject, schemas: list[g.GroundSchema]) -> Pair | None:
    """Return tests of the first instance that exclude each other if there are some in all."""
    first: Pair | None = None
    for schema in schemas:
        pair = contradiction(schema.preconditions, subject.theta)
        if pair is None:
            return None
        first = first or pair
    return first


def _unsafe(schema: g.GroundSchema, theta: list[float]) -> bool:
    """Whether the condition of an effect `(unsafe)` follows from the precondition."""
    return any(
        contradiction((*schema.preconditions, g.Not(effect.condition, effect.place)), theta)
        for effect in schema.effects
        if isinstance(effect, g.SetBoolean) and effect.target == UNSAFE_TARGET and effect.value
    )


def _always_fires(event: g.GroundSchema, theta: list[float]) -> bool:
    return all(contradiction((g.Not(test, event.place),), theta) for test in event.preconditions)


def _dead_effects(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find effects under a `when` that can hold in no instance."""
    for what, schemas in _possible(subject):
        never: dict[Place, Pair | None] = {}
        for schema in schemas:
            for effect in schema.effects:
                place, condition = effect.place, effect.condition
                if never.get(place, True) and not isinstance(condition, g.Constant):
                    pair = contradiction((*schema.preconditions, condition), subject.theta)
                    never[place] = pair and (never.get(place) or pair)
        for place, pair in never.items():
            if pair:
                yield _exclusion(f"`{place.text}` in {what} can never happen", pair, place)


def _exclusion(problem: str, pair: Pair, otherwise: Place) -> DomainWarning:
    """Return the warning of two tests that exclude each other, at the second in the file."""
    first, second = pair
    if not isinstance(first, g.Constant) and not isinstance(second, g.Constant):
        same_file = first.place.source is second.place.source
        if same_file and second.place.start < first.place.start:
            first, second = second, first
    shown = ["a condition" if isinstance(test, g.Constant) else f"`{test.place.text}`"
             for test in (first, second)]  # fmt: skip
    bounds = isinstance(first, g.Compare) and isinstance(second, g.Compare) and first != second
    why = (
        f"{shown[0]} never holds"
        if first == second
        else f"{' and '.join(shown)} exclude each other"
    )
    return DomainWarning(
        f"{problem}: {why}",
        otherwise if isinstance(second, g.Constant) else second.place,
        advice="write `or` if one of the two is enough" if bounds else "",
    )


RULES = {
    "always-true": _always_true,
    "always-unsafe": _always_unsafe,
    "contradictory-condition": _contradictory,
    "dead-effect": _dead_effects,
}
