"""The search for a way to the goal where not everything that can be reached can be followed.

Four searches share the work, because none solves what the others do (Röger & Helmert, "The more,
the merrier", ICAPS 2010). In one, those states come first that have new values, or pairs of values,
among the states that lack as many conditions of the goal (best-first width search: Lipovetzky &
Geffner, AAAI 2017); in another those of the least relaxed cost. Two go by the cost of the relaxed
plan of the state before, and evaluate a state only when its turn comes. One of these goes in turns
by the landmarks that were not true on the way, the facts that every relaxed plan makes true (lazy
greedy search: Richter & Westphal, "The LAMA planner", JAIR 2010). In all, every other state is one
that a helpful action leads to, one that begins a relaxed plan (Hoffmann & Nebel, JAIR 2001); lazy
searches take many of these after each progress. They search in rounds of twice as much work, each
as much as the others. The shortest of the ways that a round finds is taken, without the actions
that the goal does not need. Where the world has left a way, a fifth search goes breadth first to a
state from which its actions lead to the goal. Searches that have found no way lead to the state of
the least relaxed cost, and go on from there with the states that they know. States from which even
the relaxed goal is out of reach are dead ends, and no way leads there.

The relaxed domain is what every action can make true at best, deletions ignored. Conditions become
facts: that a predicate is true, that it is false, that a linear comparison holds. An operator makes
facts true at a cost. For comparisons the cost of an operator is the number of times that it has to
be repeated (Scala, Haslum & Thiébaux, "Heuristics for numeric planning via subgoaling", IJCAI
2016). What cannot be said so is taken to be true: the relaxation is optimistic.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp._core import Relaxation, WaySearch
from serp._util.saved_state import MOST, Arrays, Saved
from serp.model import ground_model as g
from serp.model.ground_model import Linear, linear
from serp.model.transition_model import TransitionModel, Vector
from serp.pddl.syntax import Change
from serp.planning.inert import inert_fluents
from serp.settings import PlannerSettings

_EVENT: Final = 2.0**-20
"""The cost of an event: next to nothing, so that only what holds costs nothing."""
_MINUS: Final = Fraction(-1)
_NEVER: Final = Linear({}, _MINUS)
_NO_CHANGE: Final = Linear({}, Fraction(0))
_KINDS: Final = (3, 2, 0, 1)
"""The searches, see `WaySearch`, in their order."""
_FIRST: Final = 5_000
"""Edges that each search follows in the first round; twice as many in every further one."""
_MEND: Final = 4
"""The search that mends a way, see `WaySearch`."""
_LEVELS: Final = 2
"""Sums that are added to sums that are added to sums of conditions are followed so far."""


def relaxed(ground: g.GroundModel, theta: Sequence[float]) -> Relaxation | None:
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
    return _Relaxation(ground, theta).result(ways[:1_000]) if ways else None


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


def _of_fluents(form: Linear) -> bool:
    """Return whether all terms of a sum are fluents."""
    return all(isinstance(atom, int) for atom in form.terms)


class _Operator(NamedTuple):
    """Facts that are needed, cost, facts that become true, known changes of fluents.

    A change is a sum of fluents, None where it is not known.
    """

    needs: list[int]
    cost: float
    adds: list[int]
    changes: dict[object, Linear | None]
    action: int = -1


class _Relaxation:
    """Collects facts and operators."""

    def __init__(self, ground: g.GroundModel, theta: Sequence[float]) -> None:
        self.theta = theta
        self.fluents = len(ground.fluents)
        self.base = 2 * self.fluents
        self.comparisons: list[tuple[Linear, bool]] = []
        self.known: dict[object, int] = {}
        self.operators: list[_Operator] = []
        for action, schema in enumerate(ground.actions):
            self._read(schema, 1.0, action)
        for schema in ground.events:
            self._read(schema, _EVENT, -1)

    def result(self, ways: Iterable[Sequence[g.Test]]) -> Relaxation:
        goals = [sorted(set(self._all(way, True))) for way in ways]
        operators = [
            (o.needs, o.cost, [(fact, 0.0, -1) for fact in o.adds], o.action)
            for o in self.operators
        ]
        first = 0
        for level in range(_LEVELS + 1):  # what is added may itself be changed by operators
            readers: dict[object, list[int]] = {}
            for k in range(first, len(self.comparisons)):
                for fluent in self.comparisons[k][0].terms:
                    readers.setdefault(fluent, []).append(k)
            first = len(self.comparisons)
            for operator, (needs, cost, adds, action) in zip(
                self.operators, tuple(operators), strict=False
            ):
                for fact, gain, amount in self._gains(operator, readers, level < _LEVELS):
                    if amount < 0:
                        adds.append((fact, gain, -1))
                    else:
                        operators.append(([*needs, amount], cost, [(fact, 0.0, amount)], action))
        return Relaxation(
            fluents=self.fluents,
            comparisons=[
                (
                    [(f, float(factor)) for f, factor in form.terms.items() if isinstance(f, int)],
                    float(form.constant),
                    strict,
                )
                for form, strict in self.comparisons
            ],
            operators=operators,
            ways=goals,
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
        if not _of_fluents(above):
            return []
        if test.operator == "=" and wanted:
            return [self._fact(above), self._fact(below)]
        if test.operator == "=":
            fact = self._fact(_NEVER)
            self.operators += [
                _Operator([self._fact(form, True)], 0.0, [fact], {}) for form in (above, below)
            ]
            return [fact]
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

    def _read(self, schema: g.GroundSchema, cost: float, action: int) -> None:
        """Add an operator for all effects of a schema that have the same condition."""
        needs = self._all(schema.preconditions, True)
        operators: dict[int, _Operator] = {}
        for effect in schema.possible_effects:
            if (condition := id(effect.condition)) not in operators:
                facts = needs + self._facts(effect.condition, True)
                operators[condition] = _Operator(facts, cost, [], {}, action)
            _, _, adds, changes, _ = operators[condition]
            if isinstance(effect, g.SetBoolean):
                adds += [2 * effect.target + effect.value] if effect.target >= 0 else []
            elif effect.target >= 0:
                amount = linear(effect.value, self.theta)
                sign = {Change.INCREASE: Fraction(1), Change.DECREASE: _MINUS}.get(effect.change)
                known = changes.get(effect.target, _NO_CHANGE)
                if sign is None or known is None or not _of_fluents(amount):
                    changes[effect.target] = None
                else:
                    changes[effect.target] = known.plus(amount, sign)
        self.operators += operators.values()

    def _gains(
        self, operator: _Operator, readers: dict[object, list[int]], exactly: bool
    ) -> Iterator[tuple[int, float, int]]:
        """Yield the comparisons that an operator may make true: their facts and gains.

        Where a gain depends on the state, the fact that it is positive is the third entry; without
        `exactly`, one application is enough.
        """
        changes = operator.changes
        for k in sorted({k for fluent in changes for k in readers.get(fluent, ())}):
            gain: Linear | None = Linear({}, Fraction(0))
            for fluent, factor in self.comparisons[k][0].terms.items():
                change = changes.get(fluent, _NO_CHANGE)
                gain = None if gain is None or change is None else gain.plus(change, factor)
            if gain is None or (gain.terms and not exactly):
                yield self.base + k, 0.0, -1
            elif gain.terms:
                yield self.base + k, 0.0, self._fact(gain, True)
            elif gain.constant > 0:
                yield self.base + k, float(gain.constant), -1


class GoalSearch:
    """Finds a way to the goal.

    Where the world moves by itself, by processes, nothing is searched for: a long way through an
    uncertain future is worth less than its values say.

    Attributes:
        steps: Edges that the last search followed.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings) -> None:
        self._model = model
        self._accepted = settings.accepted_risk
        self.steps = 0
        self._relaxed: Relaxation | None = None
        self._new: functools.partial[WaySearch]
        self._trees: list[WaySearch] = []
        self._calls: list[tuple[Vector, int, NDArray[np.int64]]] = []
        self._found = self._fresh = False
        if model.actions and not model.ground.processes:
            self._relaxed = relaxed(model.ground, model.theta.tolist())

    @property
    def goal(self) -> bool:
        """Whether there is a goal to search for."""
        return self._relaxed is not None

    def forget(self) -> None:
        """Begin anew with the next search."""
        self._trees, self._calls, self._found = [], [], False

    def way(self, state: Vector, limit: int, plan: Sequence[int] = ()) -> Vector | None:
        """Return the states `[N, F]` on a way from a state `[F]` to the goal, but the last one.

        The likeliest outcome of every step is followed, no step that is not safe, and at most
        about `limit` edges. None where there is no goal, or no way was found: the next call goes on
        with the same tree, if it holds the state.

        Args:
            state: The state.
            limit: Most edges.
            plan: Actions that led to the goal from the state where the world was to be. A way that
                goes on with them is found first, and then is the only one that is searched for.
        """
        self.steps = 0
        if self._relaxed is None:
            return None
        trees = self._grown()  # after a restart it is known then whether a way was found
        if self._found and not plan:
            self.forget()
            trees = self._grown()
        call = state.copy(), limit, np.array(plan, np.int64)
        self._calls.append(call)
        self.steps, way = self._search(trees, *call)
        if way is None and plan:  # nothing has changed
            self._calls.pop()
        elif self._fresh:
            del self._calls[:-1]
        return way

    def toward(self, state: Vector) -> int:
        """Return the action toward the goal, or the state of the least known cost; -1: none."""
        if not self._calls:
            return -1
        trees = sorted(self._grown(), key=lambda tree: tree.least)
        return next((action for tree in trees if (action := tree.toward(state)) >= 0), -1)

    def _grown(self) -> list[WaySearch]:
        """Return the trees; after a restart they are grown again by the same searches."""
        if not self._trees and self._relaxed is not None:
            model, inert = self._model, inert_fluents(self._model)
            numeric = [fluent.index for fluent in model.fluents if fluent.numeric]
            numbers = np.setdiff1d(np.array(numeric, np.int64), inert)
            self._new = functools.partial(
                WaySearch, model.core, self._relaxed, inert, numbers, self._accepted
            )
            self._trees = [self._new(kind) for kind in _KINDS]
            for call in self._calls:
                self._search(self._trees, *call)
        return self._trees

    def _search(
        self, trees: Sequence[WaySearch], state: Vector, limit: int, plan: NDArray[np.int64]
    ) -> tuple[int, Vector | None]:
        """Search in rounds; in each one all searches do as much work."""
        followed, work, best = 0, _FIRST, None
        spent = dict.fromkeys(trees, 0)
        fresh = set[WaySearch]()
        try:
            if len(plan):
                return self._mend(state, limit, plan)
            while best is None and spent and followed < limit:
                work = min(work, max(spent.values()) + max(1, (limit - followed) // len(spent)))
                for tree in [tree for tree in spent if spent[tree] < work]:
                    steps, way = tree.search(state, work - spent[tree])
                    followed += steps
                    fresh |= {tree} if tree.fresh else set()
                    if way is not None and (best is None or len(way) < len(best)):
                        best, self._trees = way, [tree]
                    spent[tree] += steps
                    if spent[tree] < work:  # nothing is left, or no room
                        del spent[tree]
                work *= 2
            if best is not None:  # what the goal does not need is left out
                steps, way = self._mend(state, limit, self._trees[0].plan())
                followed, best = followed + steps, best if way is None else way
        except MemoryError:  # no way was found
            self.forget()
            best = None
        self._found, self._fresh = best is not None, len(fresh) == len(trees)
        return followed, best

    def _mend(
        self, state: Vector, limit: int, plan: NDArray[np.int64]
    ) -> tuple[int, Vector | None]:
        """Search for a way that goes on with a plan."""
        tree = self._new(_MEND)
        tree.mend(plan)
        steps, way = tree.search(state, limit)
        if way is not None:
            self._trees, self._found, self._fresh = [tree], True, True
        return steps, way

    @property
    def least(self) -> float:
        """The least relaxed cost of the states that the newest search reached."""
        trees = self._grown() if self._calls else []
        return min((tree.least for tree in trees), default=np.inf)

    def state_dict(self) -> Arrays:
        """Return arrays that `load_state_dict` restores exactly: the searches to do again."""
        width, calls = len(self._model.fluents), self._calls
        return {
            "states": np.array([state for state, _, _ in calls]).reshape(len(calls), width),
            "limits": np.array([limit for _, limit, _ in calls], np.int64),
            "lengths": np.array([len(plan) for _, _, plan in calls], np.int64),
            "plans": np.concatenate([np.zeros(0, np.int64), *(plan for _, _, plan in calls)]),
        }

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `state_dict` returned, or raise a RunError if it is damaged."""
        self.forget()
        saved = Saved("goal search", arrays, {})
        limits = saved.array("limits", np.int64, (-1,), 1, MOST)
        states = saved.array("states", np.float64, (len(limits), len(self._model.fluents)))
        lengths = saved.array("lengths", np.int64, (len(limits),), 0, MOST)
        last = len(self._model.actions) - 1
        plans = saved.array("plans", np.int64, (int(lengths.sum()),), 0, last)
        split = np.split(plans, np.cumsum(lengths)[:-1])
        self._calls = list(zip(states, limits.tolist(), split, strict=False))
