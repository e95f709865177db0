"""The relaxed domain, as tables: what every action can make true at best, deletions ignored.

Conditions become facts: that a predicate is true, that it is false, that a linear comparison holds.
An operator makes facts true at a cost. For comparisons the cost of an operator is the number of
times that it has to be repeated (Scala, Haslum & Thiébaux, "Heuristics for numeric planning via
subgoaling", IJCAI 2016). What cannot be said so is taken to be true: the relaxation is optimistic.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from serp.model import ground as g
from serp.model.linear import Linear, linear
from serp.pddl.syntax import Change
from serp.planning.far_sight.goal_count import Ways

Item = TypeVar("Item")
_MINUS = Fraction(-1)
_ONCE = 0.0
"""In place of a gain: one application is enough."""


class RelaxedTables(NamedTuple):
    """The facts and operators of a relaxed domain.

    Facts `2 i` and `2 i + 1` say that predicate i is false, or true; comparisons follow from
    `comparisons` on; the last fact is the goal.

    Attributes:
        comparisons: `[2]` first fact that is a comparison; the fact that is the goal.
        term_first, term_fluent, term_factor, constant, strict: Comparisons: a sum of factors times
            fluents and a constant is at least 0, or positive where strict.
        user_first, user: Operators that need each fact.
        needs: `[O]` number of facts that each operator needs.
        cost: `[O]` cost of each operator.
        add_first, add_fact, add_gain: What each operator makes true; in a comparison, what one
            application adds to the sum, 0 where one is enough.
    """

    comparisons: NDArray[np.int64]
    term_first: NDArray[np.int64]
    term_fluent: NDArray[np.int64]
    term_factor: NDArray[np.float64]
    constant: NDArray[np.float64]
    strict: NDArray[np.uint8]
    user_first: NDArray[np.int64]
    user: NDArray[np.int64]
    needs: NDArray[np.int64]
    cost: NDArray[np.float64]
    add_first: NDArray[np.int64]
    add_fact: NDArray[np.int64]
    add_gain: NDArray[np.float64]


def relaxed(ground: g.GroundModel, ways: Ways, theta: Sequence[float], dt: float) -> RelaxedTables:
    """Return the relaxed domain of a model.

    Args:
        ground: The model.
        ways: The conditions of each way to reach the goal.
        theta: Parameters.
        dt: Control period.
    """
    return _Relaxation(ground, theta, dt).tables(ways)


class _Operator(NamedTuple):
    needs: list[int]
    cost: float
    effects: Sequence[g.GroundEffect]
    times: float


class _Relaxation:
    def __init__(self, ground: g.GroundModel, theta: Sequence[float], dt: float) -> None:
        self.theta, self.dt = theta, dt
        self.ground = ground
        self.base = 2 * len(ground.fluents)
        self.sums: dict[tuple[object, bool], int] = {}
        self.forms: list[tuple[Linear, bool]] = []
        self.operators: list[_Operator] = []
        self.artificial: list[tuple[list[int], int]] = []
        self.count = 0

    def tables(self, ways: Ways) -> RelaxedTables:
        ground = self.ground
        for schemas, cost, times in (
            (ground.actions, 1.0, 1.0),
            (ground.processes, 1.0, self.dt),
            (ground.events, 0.0, 1.0),
        ):
            for schema in schemas:
                self._operators_of(schema, cost, times)
        goal = self._new()
        for way in ways:
            self.artificial.append((self._all(way, True), goal))
        comparisons = self.base
        first_new = comparisons + len(self.forms)  # artificial facts come after all comparisons

        def place(fact: int) -> int:
            return fact if fact >= 0 else first_new - fact - 1

        needs = [[place(f) for f in o.needs] for o in self.operators]
        needs += [[place(f) for f in conditions] for conditions, _ in self.artificial]
        costs = [o.cost for o in self.operators] + [0.0] * len(self.artificial)
        adds = [self._adds(o) for o in self.operators]
        adds += [[(place(fact), _ONCE)] for _, fact in self.artificial]
        total = first_new + self.count
        users: list[list[int]] = [[] for _ in range(total)]
        for k, facts in enumerate(needs):
            for fact in set(facts):
                users[fact].append(k)
        terms = [
            [(int(a), float(f)) for a, f in form.terms.items() if isinstance(a, int)]
            for form, _ in self.forms
        ]
        user_first, user = _flat(users)
        add_first, added = _flat(adds)
        term_first, factors = _flat(terms)
        return RelaxedTables(
            comparisons=np.array([comparisons, place(goal)], dtype=np.int64),
            term_first=term_first,
            term_fluent=np.array([a for a, _ in factors], dtype=np.int64),
            term_factor=np.array([f for _, f in factors], dtype=np.float64),
            constant=np.array([float(form.constant) for form, _ in self.forms]),
            strict=np.array([strict for _, strict in self.forms], dtype=np.uint8),
            user_first=user_first,
            user=np.array(user, dtype=np.int64),
            needs=np.array([len(set(facts)) for facts in needs], dtype=np.int64),
            cost=np.array(costs),
            add_first=add_first,
            add_fact=np.array([fact for fact, _ in added], dtype=np.int64),
            add_gain=np.array([gain for _, gain in added], dtype=np.float64),
        )

    def _new(self) -> int:
        self.count += 1
        return -self.count

    # Conditions --------------------------------------------------------------------------------

    def _all(self, tests: Iterable[g.Test], wanted: bool) -> list[int]:
        return [fact for test in tests for fact in self._facts(test, wanted)]

    def _any(self, tests: Iterable[g.Test], wanted: bool) -> list[int]:
        """Return a fact that is true where one of some conditions is `wanted`."""
        fact = self._new()
        self.artificial += [(self._facts(test, wanted), fact) for test in tests]
        return [fact]

    def _facts(self, test: g.Test, wanted: bool) -> list[int]:
        """Return the facts that all have to hold for a condition to be `wanted`."""
        match test:
            case g.Constant(value):
                return [] if value == wanted else [self._new()]
            case g.Holds(fluent):
                return [2 * fluent + wanted] if fluent >= 0 else []
            case g.Not(operand):
                return self._facts(operand, not wanted)
            case g.All(operands):
                return self._all(operands, True) if wanted else self._any(operands, False)
            case g.AnyOf(operands):
                return self._any(operands, True) if wanted else self._all(operands, False)
            case g.Compare():
                return self._comparison(test, wanted)

    def _comparison(self, test: g.Compare, wanted: bool) -> list[int]:
        one, other = linear(test.left, self.theta), linear(test.right, self.theta)
        above = one.plus(other, _MINUS)
        if not all(isinstance(atom, int) for atom in above.terms):
            return []
        below = Linear({}, above.constant * 0).plus(above, _MINUS)
        match test.operator, wanted:
            case (">=", True) | ("<", False):
                return [self._sum(above, strict=False)]
            case (">", True) | ("<=", False):
                return [self._sum(above, strict=True)]
            case ("<=", True) | (">", False):
                return [self._sum(below, strict=False)]
            case ("<", True) | (">=", False):
                return [self._sum(below, strict=True)]
            case "=", True:
                return [self._sum(above, strict=False), self._sum(below, strict=False)]
        return []

    def _sum(self, form: Linear, *, strict: bool) -> int:
        fact = self.sums.setdefault((form.key, strict), self.base + len(self.forms))
        if fact == self.base + len(self.forms):
            self.forms.append((form, strict))
        return fact

    # Operators ---------------------------------------------------------------------------------

    def _operators_of(self, schema: g.GroundSchema, cost: float, times: float) -> None:
        needs = self._all(schema.preconditions, True)
        groups: dict[int, tuple[g.Test, list[g.GroundEffect]]] = {}
        for effect in schema.effects:
            groups.setdefault(id(effect.condition), (effect.condition, []))[1].append(effect)
        for condition, effects in groups.values():
            facts = needs + self._facts(condition, True)
            self.operators.append(_Operator(facts, cost, effects, times))

    def _adds(self, operator: _Operator) -> list[tuple[int, float]]:
        """Return the facts that an operator makes true, and the gains in comparisons."""
        adds: list[tuple[int, float]] = []
        changes: dict[int, float | None] = {}
        for effect in operator.effects:
            if effect.target < 0:
                continue
            if isinstance(effect, g.SetBoolean):
                adds.append((2 * effect.target + effect.value, _ONCE))
                continue
            amount = linear(effect.value, self.theta)
            sign = {Change.INCREASE: 1.0, Change.DECREASE: -1.0}.get(effect.change)
            known = changes.get(effect.target, 0.0)
            if sign is None or amount.terms or known is None:
                changes[effect.target] = None
            else:
                changes[effect.target] = known + sign * float(amount.constant) * operator.times
        for k in sorted({k for fluent in changes for k in self._readers.get(fluent, ())}):
            gain: float | None = 0.0
            for fluent, factor in self.forms[k][0].terms.items():
                change = changes.get(fluent, 0.0) if isinstance(fluent, int) else None
                gain = None if gain is None or change is None else gain + float(factor) * change
            if gain is None or gain > 0.0:
                adds.append((self.base + k, _ONCE if gain is None else gain))
        return adds

    @functools.cached_property
    def _readers(self) -> dict[int, list[int]]:
        """Fluent → comparisons that read it; complete when all conditions are known."""
        readers: dict[int, list[int]] = {}
        for k, (form, _) in enumerate(self.forms):
            for fluent in form.terms:
                if isinstance(fluent, int):
                    readers.setdefault(fluent, []).append(k)
        return readers


def _flat(rows: Sequence[Sequence[Item]]) -> tuple[NDArray[np.int64], list[Item]]:
    """Return where each row begins in the joined rows, and these."""
    first = np.cumsum([0, *map(len, rows)], dtype=np.int64)
    return first, [item for row in rows for item in row]
