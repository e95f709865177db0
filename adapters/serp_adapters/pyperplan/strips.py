"""A ground model as a STRIPS task: facts, and operators that need, add and delete them.

A fact is a whole number: `2 f + 1` says that fluent f is true, `2 f` that it is false. The second
kind stands for negative preconditions (the complementary facts of Gazen & Knoblock, "Combining the
expressivity of UCPOP with the efficiency of Graphplan", ECP 1997); disjunctions and conditional
effects become several operators. What the file flags unsafe is left out.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from typing import Final, NamedTuple

from serp import DomainError
from serp.model import ground_model as g
from serp.model.ground_model import linear
from serp.model.transition_model import Vector
from serp.pddl.source import Place

Facts = frozenset[int]

MOST_WAYS: Final = 500
"""Most operators that one ground action becomes, and most ways in which one condition can hold."""
_ELSEWHERE: Final = "plan with `far-sight` or `up:enhsp`, which read numbers"
_COMPARISONS: Final[dict[str, Callable[[Fraction], bool]]] = {
    "<": lambda sum_: sum_ < 0,
    "<=": lambda sum_: sum_ <= 0,
    "=": lambda sum_: sum_ == 0,
    ">=": lambda sum_: sum_ >= 0,
    ">": lambda sum_: sum_ > 0,
}


class Operator(NamedTuple):
    """Position of the ground action, -1 for none; facts that it needs, adds and deletes."""

    action: int
    needs: Facts
    adds: Facts
    deletes: Facts


class Strips:
    """What of a ground model decides whether the goal can be reached.

    Args:
        ground: The ground model.
        planner: The name of the planner, for messages.

    Attributes:
        goal: The facts that hold at the goal. Where there are several ways to reach it, a fact of
            its own, which operators without an action add.
        facts: The facts that matter.
        operators: The operators that can contribute to the goal.
        goals: The sets of facts in each of which the goal holds.
        unsafe, ends: Facts that together are unsafe, or end the task, by an event.

    Raises:
        DomainError: There is no goal, or numbers or events decide what can be done.
    """

    def __init__(self, ground: g.GroundModel, planner: str) -> None:
        if ground.goal is None:
            raise DomainError(
                f"`{planner}` searches for a way to a goal, but the problem has no goal",
                ground.syntax.place,
                "write `(:goal (and ...))` in the problem file, or plan with `far-sight`, which "
                "plans for rewards",
            )
        self._planner = planner
        self._theta = [parameter.value for parameter in ground.parameters]
        self.goals = ways = self._ways(ground.goal, True)
        made = [Operator(-1, way, frozenset({-1}), frozenset()) for way in ways]
        self.goal = ways[0] if len(ways) == 1 else frozenset({-1})
        operators = made if len(ways) != 1 else []
        for position, action in enumerate(ground.actions):
            operators += self._operators(position, action)
        damage, over = (
            [(event, self._flagging(event, flag)) for event in ground.events]
            for flag in (g.UNSAFE_TARGET, g.TERMINAL_TARGET)
        )
        self.unsafe, self.ends = ([w for _, ways in of for w in ways] for of in (damage, over))
        forbidden = [*self.unsafe, *self.ends, *self.goals]
        self.facts, self.operators = _relevant(operators, self.goal, forbidden)
        for (event, harmful), (_, last) in zip(damage, over, strict=True):
            if not (harmful or last):  # else what it changes comes too late
                self._refuse_changes(event, ground)
        self._users: dict[int, list[int]] = {}
        for position, operator in enumerate(self.operators):
            for fact in operator.needs:
                self._users.setdefault(fact, []).append(position)

    def holding(self, state: Vector) -> Facts:
        """Return the facts that matter and hold in a state `[F]`."""
        values = enumerate(state.tolist())
        return self.facts.intersection(2 * k + (value != 0.0) for k, value in values)

    def reachable(self, state: Facts) -> list[Operator]:
        """Return the operators that can become applicable if nothing is ever deleted.

        They are in order. The list is empty where the goal cannot be reached that way.
        """
        missing = [len(operator.needs) for operator in self.operators]
        found = [k for k, count in enumerate(missing) if count == 0]
        known, open_ = set(state), deque(state)
        for k in found:
            self._add(k, known, open_)
        while open_:
            for k in self._users.get(open_.popleft(), ()):
                missing[k] -= 1
                if missing[k] == 0:
                    found.append(k)
                    self._add(k, known, open_)
        return [self.operators[k] for k in sorted(found)] if self.goal <= known else []

    def _add(self, operator: int, known: set[int], open_: deque[int]) -> None:
        new = sorted(self.operators[operator].adds - known)
        known.update(new)
        open_.extend(new)

    # Conditions --------------------------------------------------------------------------------

    def _ways(self, test: g.Test, wanted: bool) -> list[Facts]:
        """Return the sets of facts in each of which a condition is `wanted`."""
        match test:
            case g.Constant(value):
                return [frozenset()] if value == wanted else []
            case g.Holds(fluent):
                if fluent < 0:  # a flag, which is false when a step begins
                    return [] if wanted else [frozenset()]
                return [frozenset({2 * fluent + wanted})]
            case g.Not(operand):
                return self._ways(operand, not wanted)
            case g.Compare():
                return self._ways(g.Constant(self._decided(test)), wanted)
            case g.All(operands, place) | g.AnyOf(operands, place):
                each = (self._ways(operand, wanted) for operand in operands)
                if isinstance(test, g.All) == wanted:
                    return self._joined(each, place)
                return self._few([way for ways in each for way in ways], place)

    def _decided(self, test: g.Compare) -> bool:
        left, right = linear(test.left, self._theta), linear(test.right, self._theta)
        if left.terms or right.terms:
            raise DomainError(
                f"`{self._planner}` plans with predicates alone, but a number decides here",
                test.place,
                f"use a predicate instead, or {_ELSEWHERE}",
            )
        return _COMPARISONS[test.operator](left.constant - right.constant)

    def _joined(self, conditions: Iterable[Sequence[Facts]], place: Place) -> list[Facts]:
        """Return the ways in which all of some conditions hold."""
        joined: list[Facts] = [frozenset()]
        for ways in conditions:
            pairs = itertools.product(joined, ways)
            joined = self._few([one | other for one, other in pairs], place)
        return [way for way in joined if not _contradictory(way)]

    def _few(self, ways: list[Facts], place: Place) -> list[Facts]:
        if len(ways) > MOST_WAYS:
            raise DomainError(
                f"there are more than {MOST_WAYS} ways in which this can hold, and "
                f"`{self._planner}` needs an operator for each",
                place,
                "split the action, use fewer `or` and `when`, or plan with `far-sight`",
            )
        return list(dict.fromkeys(ways))

    # Operators ---------------------------------------------------------------------------------

    def _operators(self, position: int, action: g.GroundSchema) -> list[Operator]:
        """Return the operators of a ground action: one for each way to apply it that is safe."""
        place = action.place
        danger = [condition for (condition,) in g.flagging(action, g.UNSAFE_TARGET)]
        if any(map(self._reads_numbers, danger)):
            return []
        conditions = [self._ways(test, True) for test in action.preconditions]
        conditions += [self._ways(condition, False) for condition in danger]
        variants = [(way, _NO_CHANGE) for way in self._joined(conditions, place)]
        for condition, changes in _changes(action):
            split = [(way, changes) for way in self._ways(condition, True)]
            split += [(way, _NO_CHANGE) for way in self._ways(condition, False)]
            pairs = itertools.product(variants, split)
            joined = [(a | b, (*done, *more)) for (a, done), (b, more) in pairs]
            variants = [(way, done) for way, done in joined if not _contradictory(way)]
            self._few([way for way, _ in variants], place)
        return [_operator(position, way, done) for way, done in variants]

    def _reads_numbers(self, test: g.Test) -> bool:
        """Whether a condition depends on numbers that vary."""
        return any(
            linear(side, self._theta).terms
            for compared in g.comparisons_of(test)
            for side in (compared.left, compared.right)
        )

    # Events ------------------------------------------------------------------------------------

    def _flagging(self, event: g.GroundSchema, flag: int) -> list[Facts]:
        """Return the facts under which an event sets a flag.

        Where numbers decide, nothing is known; the plan is checked by the model.
        """
        found: list[Facts] = []
        for tests in g.flagging(event, flag):
            if not any(map(self._reads_numbers, tests)):
                found += self._joined((self._ways(test, True) for test in tests), event.place)
        return found

    def _refuse_changes(self, event: g.GroundSchema, ground: g.GroundModel) -> None:
        for effect in event.effects:
            target = effect.target
            if isinstance(effect, g.SetBoolean) and {2 * target, 2 * target + 1} & self.facts:
                raise DomainError(
                    f"`{self._planner}` knows no events, but this one changes "
                    f"`{ground.fluents[target].name}`, which conditions read",
                    effect.place,
                    "make it an effect of the actions, or plan with `far-sight`",
                )


Changes = tuple[tuple[int, bool], ...]
"""Fluents and the values that they get."""
_NO_CHANGE: Final[Changes] = ()


def _contradictory(way: Facts) -> bool:
    return any(fact % 2 and fact - 1 in way for fact in way)


def _changes(action: g.GroundSchema) -> list[tuple[g.Test, Changes]]:
    """Return the predicates that an action changes under each condition."""
    found: dict[int, tuple[g.Test, Changes]] = {}
    for effect in action.effects:
        if isinstance(effect, g.SetBoolean) and effect.target >= 0:
            condition, known = found.get(id(effect.condition), (effect.condition, _NO_CHANGE))
            found[id(condition)] = condition, (*known, (effect.target, effect.value))
    return list(found.values())


def _operator(action: int, way: Facts, changes: Changes) -> Operator:
    """Return the operator; what is both deleted and added is true afterwards."""
    true = {fluent for fluent, value in changes if value}
    false = {fluent for fluent, _ in changes} - true
    adds = frozenset({2 * f + 1 for f in true} | {2 * f for f in false})
    return Operator(action, way, adds - way, frozenset(fact ^ 1 for fact in adds))


def _relevant(
    operators: list[Operator], goal: Facts, watched: list[Facts]
) -> tuple[Facts, list[Operator]]:
    """Return the facts that matter for the goal, and the operators that add some of them.

    A fact matters if the goal has it, if it keeps something watched from being true, or if an
    operator that adds a fact that matters needs it. What is watched itself is only kept track of.
    """
    adders: dict[int, list[Operator]] = {}
    for operator in operators:
        for fact in operator.adds:
            adders.setdefault(fact, []).append(operator)
    facts = set(goal)
    for way in watched:
        facts |= {fact ^ 1 for fact in way}
    open_ = list(facts)
    while open_:
        for operator in adders.get(open_.pop(), ()):
            new = operator.needs - facts
            facts |= new
            open_ += new
    kept = frozenset(facts).union(*watched)
    trimmed = (o._replace(adds=o.adds & kept, deletes=o.deletes & kept) for o in operators)
    return kept, [operator for operator in trimmed if operator.adds]
