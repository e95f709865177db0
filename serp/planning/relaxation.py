"""The relaxed domain, as tables: what every action can make true at best, deletions ignored.

Conditions become facts: that a predicate is true, that it is false, that a linear comparison holds.
An operator makes facts true at a cost. For comparisons the cost of an operator is the number of
times that it has to be repeated (Scala, Haslum & Thiébaux, "Heuristics for numeric planning via
subgoaling", IJCAI 2016). What cannot be said so is taken to be true: the relaxation is optimistic.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp.model import ground_model as g
from serp.model.ground_model import Linear, linear
from serp.pddl.syntax import Change

Item = TypeVar("Item")

_EVENT: Final = 2.0**-20
"""The cost of an event: next to nothing, so that only what holds costs nothing."""
_MINUS: Final = Fraction(-1)
_NEVER: Final = Linear({}, _MINUS)


class RelaxedTables(NamedTuple):
    """The facts and operators of a relaxed domain.

    Facts `2 i` and `2 i + 1` say that fluent i is 0, or is not; the others are comparisons.

    Attributes:
        term_first, term_fluent, term_factor, constant, strict: Comparisons: a sum of factors times
            fluents and a constant is at least 0, or positive where strict.
        user_first, user: Operators that need each fact.
        needs: `[O]` number of facts that each operator needs.
        cost: `[O]` cost of each operator.
        add_first, add_fact, add_gain: What each operator makes true; in a comparison, what one
            application adds to the sum, 0 where one is enough.
        way_first, way_fact: Ways to reach the goal: the facts that each needs.
    """

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
    way_first: NDArray[np.int64]
    way_fact: NDArray[np.int64]


def relaxed(ground: g.GroundModel, theta: Sequence[float]) -> RelaxedTables | None:
    """Return the relaxed domain of a model without processes; None where there is no goal.

    The goal is the problem's; a domain without one is done where an action or event ends the task
    and increases the reward.
    """
    if ground.goal is not None:
        goal = ground.goal.operands if isinstance(ground.goal, g.AnyOf) else (ground.goal,)
        ways: list[tuple[g.Test, ...]] = [(way,) for way in goal]
    else:
        schemas = (*ground.events, *ground.actions)
        ways = [s.preconditions for s in schemas if succeeds(s, theta)]
    return _Relaxation(ground, theta).tables(ways[:1_000]) if ways else None


def succeeds(schema: g.GroundSchema, theta: Sequence[float]) -> bool:
    """Whether a schema always ends the task and increases the reward by a number of the file."""
    certain = [e for e in schema.effects if e.condition == g.Constant(True)]
    ends = any(isinstance(e, g.SetBoolean) and e.target == g.TERMINAL_TARGET for e in certain)
    return ends and any(
        isinstance(effect, g.SetNumber)
        and effect.target == g.REWARD_TARGET
        and isinstance(effect.value, g.ParameterRef)
        and (theta[effect.value.parameter] > 0.0) == (effect.change is Change.INCREASE)
        for effect in certain
    )


class _Operator(NamedTuple):
    """Facts that are needed, cost, facts that become true, known changes of fluents.

    A change is None where it is not known.
    """

    needs: list[int]
    cost: float
    adds: list[int]
    changes: dict[object, float | None]


class _Relaxation:
    """Collects facts and operators."""

    def __init__(self, ground: g.GroundModel, theta: Sequence[float]) -> None:
        self.theta = theta
        self.base = 2 * len(ground.fluents)
        self.comparisons: list[tuple[Linear, bool]] = []
        self.known: dict[object, int] = {}
        self.operators: list[_Operator] = []
        for schemas, cost in ((ground.actions, 1.0), (ground.events, _EVENT)):
            for schema in schemas:
                self._read(schema, cost)

    def tables(self, ways: Iterable[Sequence[g.Test]]) -> RelaxedTables:
        goals = [sorted(set(self._all(way, True))) for way in ways]
        readers: dict[object, list[int]] = {}
        for k, (form, _) in enumerate(self.comparisons):
            for fluent in form.terms:
                readers.setdefault(fluent, []).append(k)
        users: list[list[int]] = [[] for _ in range(self.base + len(self.comparisons))]
        for k, operator in enumerate(self.operators):
            for fact in set(operator.needs):
                users[fact].append(k)
        user_first, user = _flat(users)
        add_first, adds = _flat([self._adds(operator, readers) for operator in self.operators])
        term_first, terms = _flat([list(form.terms.items()) for form, _ in self.comparisons])
        way_first, way_fact = _flat(goals)
        return RelaxedTables(
            term_first=term_first,
            term_fluent=np.array([fluent for fluent, _ in terms], dtype=np.int64),
            term_factor=np.array([factor for _, factor in terms], dtype=np.float64),
            constant=np.array([float(form.constant) for form, _ in self.comparisons]),
            strict=np.array([strict for _, strict in self.comparisons], dtype=np.uint8),
            user_first=user_first,
            user=np.array(user, dtype=np.int64),
            needs=np.array([len(set(o.needs)) for o in self.operators], dtype=np.int64),
            cost=np.array([o.cost for o in self.operators], dtype=np.float64),
            add_first=add_first,
            add_fact=np.array([fact for fact, _ in adds], dtype=np.int64),
            add_gain=np.array([gain for _, gain in adds], dtype=np.float64),
            way_first=way_first,
            way_fact=np.array(way_fact, dtype=np.int64),
        )

    # Conditions --------------------------------------------------------------------------------

    def _all(self, tests: Iterable[g.Test], wanted: bool) -> list[int]:
        return [fact for test in tests for fact in self._facts(test, wanted)]

    def _any(self, tests: Iterable[g.Test], wanted: bool) -> list[int]:
        """Return a fact that is true where one of some conditions is `wanted`."""
        fact = self._fact(_NEVER)
        self.operators += [_Operator(self._facts(t, wanted), 0.0, [fact], {}) for t in tests]
        return [fact]

    def _facts(self, test: g.Test, wanted: bool) -> list[int]:
        """Return the facts that all have to hold for a condition to be `wanted`."""
        match test:
            case g.Constant(value):
                return [] if value == wanted else [self._fact(_NEVER)]
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
        above = linear(test.left, self.theta).plus(linear(test.right, self.theta), _MINUS)
        below = Linear({}, Fraction(0)).plus(above, _MINUS)
        if not all(isinstance(atom, int) for atom in above.terms):
            return []
        if test.operator == "=":
            return [self._fact(above), self._fact(below)] if wanted else []
        up = (test.operator in (">", ">=")) == wanted
        return [self._fact(above if up else below, (test.operator in (">", "<")) == wanted)]

    def _fact(self, form: Linear, strict: bool = False) -> int:
        """Return the fact that a sum is at least 0, or positive; one that never holds is new."""
        fact = self.base + len(self.comparisons)
        if form is not _NEVER:
            fact = self.known.setdefault((form.key, strict), fact)
        if fact == self.base + len(self.comparisons):
            self.comparisons.append((form, strict))
        return fact

    # Operators ---------------------------------------------------------------------------------

    def _read(self, schema: g.GroundSchema, cost: float) -> None:
        """Add an operator for all effects of a schema that have the same condition."""
        needs = self._all(schema.preconditions, True)
        operators: dict[int, _Operator] = {}
        for effect in schema.effects:
            if (condition := id(effect.condition)) not in operators:
                facts = needs + self._facts(effect.condition, True)
                operators[condition] = _Operator(facts, cost, [], {})
            _, _, adds, changes = operators[condition]
            if isinstance(effect, g.SetBoolean):
                adds += [2 * effect.target + effect.value] if effect.target >= 0 else []
            elif effect.target >= 0:
                amount = linear(effect.value, self.theta)
                sign = {Change.INCREASE: 1.0, Change.DECREASE: -1.0}.get(effect.change)
                known = changes.get(effect.target, 0.0)
                if sign is None or amount.terms or known is None:
                    changes[effect.target] = None
                else:
                    changes[effect.target] = known + sign * float(amount.constant)
        self.operators += operators.values()

    def _adds(
        self, operator: _Operator, readers: dict[object, list[int]]
    ) -> list[tuple[int, float]]:
        """Return the facts that an operator makes true, and the gains in comparisons."""
        adds = [(fact, 0.0) for fact in operator.adds]
        changes = operator.changes
        for k in sorted({k for fluent in changes for k in readers.get(fluent, ())}):
            parts = [
                (float(factor), changes.get(fluent, 0.0))
                for fluent, factor in self.comparisons[k][0].terms.items()
            ]
            gain = sum(factor * change for factor, change in parts if change is not None)
            unknown = any(change is None for _, change in parts)
            if unknown or gain > 0.0:
                adds.append((self.base + k, 0.0 if unknown else gain))
        return adds


def _flat(rows: Sequence[Sequence[Item]]) -> tuple[NDArray[np.int64], list[Item]]:
    """Return where each row begins in the joined rows, and these."""
    first = np.cumsum([0, *map(len, rows)], dtype=np.int64)
    return first, [item for row in rows for item in row]


# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"


class RelaxedCosts(NamedTuple):
    """Memory for the costs of one state.

    Attributes:
        cost: Of each fact; infinite while it is unreachable.
        passed: The cost of each fact that its operators know.
        gap: Of each comparison: what the sum lacks.
        queue, queued: Facts whose operators are to be updated, a ring, and whether they are in it.
        missing, sums: Of each operator: facts that are unreachable, costs of the others.
    """

    cost: NDArray[np.float64]
    passed: NDArray[np.float64]
    gap: NDArray[np.float64]
    queue: NDArray[np.int64]
    queued: NDArray[np.uint8]
    missing: NDArray[np.int64]
    sums: NDArray[np.float64]

    @classmethod
    def allocate(cls, tables: RelaxedTables) -> RelaxedCosts:
        """Allocate room for the facts and operators of a relaxed domain."""
        facts, operators = len(tables.user_first) - 1, len(tables.needs)
        cost, passed = np.zeros((2, facts))
        return cls(
            cost, passed, gap=np.zeros(len(tables.constant)),
            queue=np.zeros(facts + 1, dtype=np.int64), queued=np.zeros(facts, dtype=np.uint8),
            missing=np.zeros(operators, dtype=np.int64), sums=np.zeros(operators),
        )  # fmt: skip


@cached_njit(nogil=True, forceinline=True)
def _push(work, fact, end):
    """Put a fact into the ring; return the new end."""
    if work.queued[fact]:
        return end
    work.queued[fact] = 1
    work.queue[end] = fact
    end += 1
    return end if end < work.queue.shape[0] else np.int64(0)


@cached_njit(nogil=True, forceinline=True)
def _apply(tables, work, operator, end):
    """Lower the costs of what an operator makes true; return the new end of the ring."""
    for k in range(tables.add_first[operator], tables.add_first[operator + 1]):
        fact, gain = tables.add_fact[k], tables.add_gain[k]
        times = 1.0
        if gain > 0.0:
            comparison = fact - work.cost.shape[0] + work.gap.shape[0]
            times = max(1.0, np.ceil(work.gap[comparison] / gain))
        cost = work.sums[operator] + times * tables.cost[operator]
        if cost < work.cost[fact] - 1e-9:
            work.cost[fact] = cost
            end = _push(work, fact, end)
    return end


@cached_njit(nogil=True, forceinline=True)
def _begin(tables, work, state):
    """Set the costs of the facts that hold to 0; return the end of the ring."""
    end, base = np.int64(0), work.cost.shape[0] - work.gap.shape[0]
    for fact in range(work.cost.shape[0]):
        work.cost[fact] = work.passed[fact] = np.inf
        work.queued[fact] = 0
    for i in range(base // 2):
        work.cost[2 * i + (1 if state[i] != 0.0 else 0)] = 0.0
    for k in range(work.gap.shape[0]):
        total = tables.constant[k]
        for t in range(tables.term_first[k], tables.term_first[k + 1]):
            total += tables.term_factor[t] * state[tables.term_fluent[t]]
        work.gap[k] = -total
        if total > 0.0 or (total == 0.0 and not tables.strict[k]):
            work.cost[base + k] = 0.0
    for fact in range(work.cost.shape[0]):
        if work.cost[fact] == 0.0 and tables.user_first[fact] < tables.user_first[fact + 1]:
            end = _push(work, fact, end)
    for operator in range(work.missing.shape[0]):
        work.missing[operator] = tables.needs[operator]
        work.sums[operator] = 0.0
        if work.missing[operator] == 0:
            end = _apply(tables, work, operator, end)
    return end


@cached_njit(nogil=True)
def relaxed_cost(tables_arrays, work_arrays, state):
    """Find how far away the goal is from a state, a pointer; the rest are values of the records.

    Returns:
        Its additive cost, infinite if it is unreachable; the least number of facts of a way to it
        that do not hold.
    """
    tables, work = RelaxedTables(*tables_arrays), RelaxedCosts(*work_arrays)
    end, start = _begin(tables, work, state), np.int64(0)
    while start != end:
        fact = work.queue[start]
        start += 1
        if start == work.queue.shape[0]:
            start = np.int64(0)
        work.queued[fact] = 0
        before, cost = work.passed[fact], work.cost[fact]
        work.passed[fact] = cost
        for k in range(tables.user_first[fact], tables.user_first[fact + 1]):
            operator = tables.user[k]
            if before == np.inf:
                work.missing[operator] -= 1
                work.sums[operator] += cost
            else:
                work.sums[operator] += cost - before
            if work.missing[operator] == 0:
                end = _apply(tables, work, operator, end)
    least, left = np.inf, np.int64(work.cost.shape[0])
    for way in range(tables.way_first.shape[0] - 1):
        cost, lacks = 0.0, np.int64(0)
        for k in range(tables.way_first[way], tables.way_first[way + 1]):
            cost += work.cost[tables.way_fact[k]]
            lacks += work.cost[tables.way_fact[k]] > 0.0
        least, left = min(least, cost), min(left, lacks)
    return least, left
