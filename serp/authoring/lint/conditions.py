"""Rules: conditions that never hold, and actions that are never safe."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import combinations, permutations

from serp.authoring.lint.subject import LintSubject
from serp.model import ground as g
from serp.model.ground import TERMINAL_TARGET, UNSAFE_TARGET, Linear, linear
from serp.pddl.source import DomainWarning, Edit, Fix, Place
from serp.pddl.syntax import Kind

Pair = tuple[g.Test, g.Test]
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

    low: tuple[Fraction, bool, g.Test] | None = None  # value, whether strict, test
    high: tuple[Fraction, bool, g.Test] | None = None
    excluded: dict[Fraction, g.Test] = field(default_factory=dict)

    def add(self, operator: str, value: Fraction, test: g.Test) -> Pair | None:
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
        told: g.Test | None = None,
    ) -> Pair | None:
        """Add a test, or its negation; return what excludes each other.

        `later` takes the disjunctions; `told` is the test as the file has it.
        """
        told = test if told is None else told
        match test:
            case g.Constant(value):
                return (told, told) if value != holds else None
            case g.Not(operand):
                return self.add(operand, later, holds=not holds, told=told)
            case g.Holds(fluent):
                known = self.truths.setdefault(fluent, (holds, told))
                return (known[1], told) if known[0] != holds else None
            case g.Compare():
                return self._compare(test, told, holds=holds)
            case g.All(operands) | g.AnyOf(operands) if isinstance(test, g.All) == holds:
                pairs = (self.add(operand, later, holds=holds) for operand in operands)
                return next((pair for pair in pairs if pair), None)
            case g.All(operands) | g.AnyOf(operands):
                if not holds:
                    operands = tuple(g.Not(operand, test.place) for operand in operands)
                later.append(g.AnyOf(operands, test.place))
                return None

    def _compare(self, test: g.Compare, told: g.Test, *, holds: bool) -> Pair | None:
        operator = test.operator if holds else _NEGATED.get(test.operator, "!=")
        form = _difference(test, self.theta)
        if not form.terms:
            return None if _is_true(operator, form.constant) else (told, told)
        first = min(form.terms, key=repr)
        factor = form.terms[first]
        key = frozenset((atom, k / factor) for atom, k in form.terms.items())
        if factor < 0:
            operator = _MIRRORED.get(operator, operator)
        value = -form.constant / factor
        if len(key) == 1 and isinstance(first, tuple) and first[0] in _RANGES:
            low, high = _RANGES[first[0]]
            if _is_out(operator, value, low, high):
                return told, told
        return self.bounds.setdefault(key, _Bounds()).add(operator, value, told)


def _is_out(operator: str, value: Fraction, low: float, high: float) -> bool:
    """Whether no number from low to high stands in a relation to a value."""
    return {
        "<": value <= low,
        "<=": value < low,
        "=": not low <= value <= high,
        ">=": value > high,
        ">": value >= high,
    }.get(operator, False)


def _is_true(operator: str, difference: Fraction) -> bool:
    return {
        "<": difference < 0,
        "<=": difference <= 0,
        "=": difference == 0,
        "!=": difference != 0,
        ">=": difference >= 0,
        ">": difference > 0,
    }[operator]


def _difference(test: g.Compare, theta: Sequence[float]) -> Linear:
    return linear(test.left, theta).plus(linear(test.right, theta), Fraction(-1))


Leaf = g.Compare | g.Holds | g.Not
Found = dict[Place, tuple[Leaf, ...] | None]
"""Place of a condition → what is found of it, in one instance; None for nothing."""
_BEYOND = {"<": ">", "<=": ">", ">": "<", ">=": "<"}
"""Comparison → what holds where it does not hold, but for one number."""
_MOST = 40
"""Operands of one list that are compared with one another."""
_POSITIVE = re.compile(r"\s(\d[\d.]*)\s*\)\Z")


def _always_true(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find comparisons that hold in every state, alone or with another one of the same `or`."""

    def alone(test: g.Test) -> Found:
        if not isinstance(test, g.Compare) or _depends_on_problem(test, subject.anywhere):
            return {}
        always = contradiction((g.Not(test, test.place),), subject.theta)
        return {test.place: (test,)} if always else {}

    def together(test: g.Test) -> Found:
        found: Found = {}
        leaves = _leaves(test, subject.anywhere) if isinstance(test, g.AnyOf) else []
        for first, second in combinations(leaves, 2):
            if not subject.alike(first, second):
                continue
            both = contradiction((_beyond(first), _beyond(second)), subject.theta)
            if both and both[0] != both[1]:
                found[second.place] = (first, second)
        return found

    for what, schemas in _named(subject):
        for place, _ in _in_every_instance(schemas, subject.theta, (g.Compare,), alone):
            yield DomainWarning(f"`{place.text}` in {what} always holds", place)
        for place, (first, second) in _in_every_instance(
            schemas, subject.theta, (g.AnyOf,), together
        ):
            fix = _with_minus(second.place)
            yield DomainWarning(
                f"`{first.place.text}` or `{place.text}` always holds in {what}",
                place,
                advice="is a minus missing?" if fix else "",
                fix=fix,
            )


def _needless(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find conditions that follow from another one of the same `and`, or imply one of an `or`."""

    def implied(test: g.Test) -> Found:
        found: Found = {}
        leaves = _leaves(test, subject.anywhere)
        if contradiction(leaves, subject.theta) and isinstance(test, g.All):
            return found
        for (k, first), (m, second) in permutations(enumerate(leaves), 2):
            if not subject.alike(first, second):
                continue
            if isinstance(test, g.All):
                stronger, weaker = first, second
            else:
                stronger, weaker = second, first
            if contradiction((g.Not(second, second.place),), subject.theta):
                continue  # it always holds, which is another finding
            if _implies(stronger, weaker, subject) and (
                m > k or not _implies(weaker, stronger, subject)  # of equal ones, the later
            ):
                found.setdefault(second.place, (first, second))
        for either in _disjunctions(test):
            if contradiction((g.Not(either, either.place),), subject.theta):
                continue
            stronger_leaf = (leaf for leaf in leaves if _implies(leaf, either, subject))
            if (first_leaf := next(stronger_leaf, None)) is not None:
                found.setdefault(either.place, (first_leaf, first_leaf))
        return found

    for what, schemas in _named(subject):
        for place, (other, _) in _in_every_instance(
            schemas, subject.theta, (g.All, g.AnyOf), implied
        ):
            why = (
                "stands there twice"
                if place.text == other.place.text
                else f"is needless beside `{other.place.text}`"
            )
            advice = "is it meant to say something else?"
            yield DomainWarning(f"`{place.text}` in {what} {why}", place, advice=advice)


def _dead_alternative(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find alternatives of an `or` that can never hold, alone or beside what else has to hold."""

    def dead(test: g.Test) -> Found:
        beside = test.operands if isinstance(test, g.All) else ()
        found: Found = {}
        for either in _disjunctions(test) or ([test] if isinstance(test, g.AnyOf) else []):
            others = [other for other in beside if other is not either]
            for alternative in either.operands[:_MOST]:
                if isinstance(alternative, g.Constant | g.AnyOf):
                    continue
                never = contradiction((*others, alternative), subject.theta)
                found[alternative.place] = () if never else None
        return found

    for what, schemas in _named(subject):
        for place, _ in _in_every_instance(schemas, subject.theta, (g.All, g.AnyOf), dead):
            yield DomainWarning(f"the alternative `{place.text}` in {what} can never hold", place)


def _disjunctions(test: g.Test) -> list[g.AnyOf]:
    """Return the disjunctions among the operands of a conjunction."""
    operands = test.operands if isinstance(test, g.All) else ()
    return [operand for operand in operands if isinstance(operand, g.AnyOf)]


def _implies(first: Leaf, second: Leaf | g.AnyOf, subject: LintSubject) -> bool:
    return contradiction((first, g.Not(second, second.place)), subject.theta) is not None


def _beyond(test: Leaf) -> g.Test:
    """Return what holds where a test does not, a single number left aside."""
    if isinstance(test, g.Compare) and test.operator in _BEYOND:
        return replace(test, operator=_BEYOND[test.operator])
    return g.Not(test, test.place)


def _named(subject: LintSubject) -> Iterator[tuple[str, Sequence[g.GroundSchema]]]:
    """Yield kind with name, and the instances of each schema."""
    for name, schemas in subject.telling.items():
        yield f"{schemas[0].kind.value} `{name}`", schemas


def _in_every_instance(
    schemas: Sequence[g.GroundSchema],
    theta: Sequence[float],
    kinds: tuple[type, ...],
    look: Callable[[g.Test], Found],
) -> Iterator[tuple[Place, tuple[Leaf, ...]]]:
    """Yield what is found of a condition in all instances that have it and can happen."""
    found: dict[Place, tuple[Leaf, ...]] = {}
    refuted: set[Place] = set()
    for schema in schemas:
        tests = [
            g.All(tuple(schema.preconditions), schema.place),
            *dict.fromkeys(effect.condition for effect in schema.effects),
        ]
        parts = (part for test in tests for part in _parts(test) if isinstance(part, kinds))
        open_parts = [part for part in parts if not refuted >= _places(part)]
        if not open_parts or contradiction(schema.preconditions, theta):
            continue
        for part in open_parts:
            here = look(part)
            refuted |= _places(part) - here.keys()
            for place, leaves in here.items():
                if leaves is None:
                    refuted.add(place)
                else:
                    found.setdefault(place, leaves)
    yield from ((place, here) for place, here in found.items() if place not in refuted)


def _places(test: g.Test) -> set[Place]:
    """Return the places of which something could be found in a condition."""
    operands = test.operands if isinstance(test, g.All | g.AnyOf) else (test,)
    return {operand.place for operand in operands if not isinstance(operand, g.Constant)}


def _parts(test: g.Test) -> Iterator[g.Test]:
    """Yield a condition and those in it."""
    yield test
    match test:
        case g.All(operands) | g.AnyOf(operands):
            for operand in operands:
                yield from _parts(operand)
        case g.Not(operand):
            yield from _parts(operand)


def _leaves(test: g.Test, ground: g.GroundModel) -> list[Leaf]:
    """Return the operands of a list that have none of their own."""
    operands = test.operands if isinstance(test, g.All | g.AnyOf) else ()
    return [
        operand
        for operand in operands[:_MOST]
        if isinstance(operand, g.Compare | g.Holds)
        or (isinstance(operand, g.Not) and isinstance(operand.operand, g.Compare | g.Holds))
        if not _depends_on_problem(operand, ground)
    ]


def _depends_on_problem(test: g.Test, ground: g.GroundModel) -> bool:
    """Whether a test compares with a number that another problem may give otherwise."""
    return any(
        ground.parameters[number].role == "initial"
        for comparison in g.comparisons_of(test)
        for number in (*_numbers(comparison.left), *_numbers(comparison.right))
    )


def _numbers(value: g.Value) -> Iterator[int]:
    match value:
        case g.ParameterRef(parameter):
            yield parameter
        case g.Operation(_, left, right):
            yield from _numbers(left)
            yield from _numbers(right)
        case g.Unary(_, operand):
            yield from _numbers(operand)


def _with_minus(place: Place) -> Fix | None:
    """Return the guess that the number at the end of a comparison should be negative."""
    number = _POSITIVE.search(place.source.text, place.start, place.end)
    if number is None:
        return None
    return Fix((Edit(number.start(1), number.start(1), "-"),), sure=False)


RULES = {
    "always-true": _always_true,
    "redundant-condition": _needless,
    "dead-alternative": _dead_alternative,
}


_CANNOT = {
    Kind.ACTION: "can never be applied",
    Kind.PROCESS: "can never run",
    Kind.EVENT: "can never fire",
}


def _contradictory(subject: LintSubject) -> Iterator[DomainWarning]:
    for name, schemas in subject.telling.items():
        if pair := _contradiction_in_all(subject, schemas):
            kind, place = schemas[0].kind, schemas[0].place.opening
            yield DomainWarning(
                f"{kind.value} `{name}` {_CANNOT[kind]}: {_exclude(pair)}",
                _second(pair, place),
                advice=_or_instead(pair),
            )


def _not_reached(subject: LintSubject) -> Iterator[DomainWarning]:
    reached = {schema.schema for schema in subject.domain.model.ground.schemas}
    for name, schemas in subject.instances.items():
        telling = subject.telling.get(name, [])
        if name not in reached and not _contradiction_in_all(subject, telling):
            kind, place = schemas[0].kind, schemas[0].place.opening
            yield DomainWarning(
                f"{kind.value} `{name}` {_CANNOT[kind]} from the problem's :init on", place
            )


def _always_unsafe(subject: LintSubject) -> Iterator[DomainWarning]:
    for what, schemas in _possible(subject):
        kind, place = schemas[0].kind, schemas[0].place.opening
        if kind is Kind.ACTION and all(_unsafe(schema, subject.theta) for schema in schemas):
            yield DomainWarning(
                f"{what} is unsafe wherever it can be applied: it is executed only where every "
                "other action is unsafe too",
                place,
            )
        if kind is Kind.EVENT and any(
            _makes_all_unsafe(schema, subject.theta) for schema in schemas
        ):
            yield DomainWarning(f"{what} makes every action unsafe: it always fires", place)


def _possible(subject: LintSubject) -> Iterator[tuple[str, list[g.GroundSchema]]]:
    """Yield kind with name, and instances, of the schemas that can happen."""
    reached = {schema.schema for schema in subject.domain.model.ground.schemas}
    for name, schemas in subject.telling.items():
        if name in reached and not _contradiction_in_all(subject, schemas):
            yield f"{schemas[0].kind.value} `{name}`", schemas


def _contradiction_in_all(subject: LintSubject, schemas: list[g.GroundSchema]) -> Pair | None:
    """Return tests of the first instance that exclude each other if there are some in all."""
    return _in_all(contradiction(schema.preconditions, subject.theta) for schema in schemas)


def _in_all(pairs: Iterable[Pair | None]) -> Pair | None:
    """Return the first pair if there is one everywhere."""
    first: Pair | None = None
    for pair in pairs:
        if pair is None:
            return None
        first = first or pair
    return first


def _unsafe(schema: g.GroundSchema, theta: list[float]) -> bool:
    for effect in schema.effects:
        if isinstance(effect, g.SetBoolean) and effect.target == UNSAFE_TARGET and effect.value:
            # The condition follows from the precondition where its opposite contradicts it.
            opposite = g.Not(effect.condition, effect.place)
            if contradiction((*schema.preconditions, opposite), theta):
                return True
    return False


def _makes_all_unsafe(event: g.GroundSchema, theta: list[float]) -> bool:
    """Say whether nothing keeps an event from firing, and from damage where it fires."""
    fires = all(
        contradiction((g.Not(condition, event.place),), theta) for condition in event.preconditions
    )
    return fires and _unsafe(event, theta)


def _dead_effects(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find effects under a `when` that can hold in no instance."""
    for what, schemas in _possible(subject):
        yield from _never_in_any(what, schemas, subject.theta)


def _flags_never_set(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find events that wait for a flag which is only ever set where they cannot fire."""
    ground, told = subject.anywhere, set[str]()
    moved = {target for event in ground.events for target in g.writes(event)}
    for event in ground.events:
        for read in event.preconditions:
            if not isinstance(read, g.Holds) or read.fluent not in (UNSAFE_TARGET, TERMINAL_TARGET):
                continue
            pairs = _excluded_setters(subject, event, read)
            # What other events change may differ by the time this one reads the flag.
            still = all(moved.isdisjoint(f) for p in pairs for t in p for f in [{*g.fluents_of(t)}])
            if pairs and still and event.schema not in told:
                told.add(event.schema)
                yield DomainWarning(
                    f"event `{event.schema}` can never fire: where `{read.place.text}` is made "
                    f"true, {_exclude(pairs[0])}",
                    read.place,
                )


def _excluded_setters(subject: LintSubject, event: g.GroundSchema, read: g.Holds) -> list[Pair]:
    """Return what keeps an event from firing beside each setter of a flag; [] if one does not."""
    others = [test for test in event.preconditions if test is not read]
    pairs: list[Pair] = []
    for schema in subject.anywhere.schemas:
        for effect in schema.effects:
            if effect.target != read.fluent or schema.name == event.name:
                continue
            tests = (*schema.preconditions, effect.condition, *others)
            pair = contradiction(tests, subject.theta) if schema.kind is Kind.EVENT else None
            if pair is None:  # an action sets it: what it finds may change within the step
                return []
            pairs.append(pair)
    return pairs


def _never_in_any(
    what: str, schemas: list[g.GroundSchema], theta: list[float]
) -> Iterator[DomainWarning]:
    possible: set[Place] = set()
    never: dict[Place, Pair] = {}
    for schema in schemas:
        for effect in schema.effects:
            if effect.place in possible or isinstance(effect.condition, g.Constant):
                continue
            pair = contradiction((*schema.preconditions, effect.condition), theta)
            if pair is None:
                possible.add(effect.place)
            else:
                never.setdefault(effect.place, pair)
    for place, pair in never.items():
        if place not in possible:
            yield DomainWarning(
                f"`{place.text}` in {what} can never happen: {_exclude(pair)}",
                _second(pair, place),
                advice=_or_instead(pair),
            )


def _exclude(pair: Pair) -> str:
    first, second = (_shown(test) for test in _in_order(pair))
    return f"{first} never holds" if first == second else f"{first} and {second} exclude each other"


def _or_instead(pair: Pair) -> str:
    bounds = all(isinstance(test, g.Compare) for test in pair) and pair[0] != pair[1]
    return "write `or` if one of the two is enough" if bounds else ""


def _shown(test: g.Test) -> str:
    return "a condition" if isinstance(test, g.Constant) else f"`{test.place.text}`"


def _second(pair: Pair, otherwise: Place) -> Place:
    second = _in_order(pair)[1]
    return otherwise if isinstance(second, g.Constant) else second.place


def _in_order(pair: Pair) -> Pair:
    """Return two tests as they stand in the file."""
    first, second = pair
    if isinstance(first, g.Constant) or isinstance(second, g.Constant):
        return pair
    same_file = first.place.source is second.place.source
    return (second, first) if same_file and second.place.start < first.place.start else pair


RULES_OF_SEMANTICS = {
    "contradictory-condition": _contradictory,
    "not-reached": _not_reached,
    "always-unsafe": _always_unsafe,
    "dead-effect": _dead_effects,
    "flag-never-set": _flags_never_set,
}
