"""Whole plans to the goal, from the closed graph or the search for a way."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from serp.model import ground_model as g
from serp.model.transition_model import TransitionModel, Vector
from serp.pddl.syntax import Change
from serp.planning.closed_graph import MAX_EDGES, ClosedGraph
from serp.planning.goal_search import GoalSearch
from serp.planning.inert import inert_fluents
from serp.settings import PlannerSettings

_SMALL: Final = 20_000
"""Edges of the graph that is tried first, and of the neighbourhood of a way."""
_GROWTH: Final = 8
"""Each search follows so many times as many edges as the one before."""
_MOST: Final = 1 << 30
_SETTINGS: Final = PlannerSettings(discount=0.9999)
"""Almost no discount, so that the metric decides between plans, and yet a shorter one is better."""


class Found(NamedTuple):
    """What a search found.

    Attributes:
        plan: Positions of the ground actions; None if there is no plan.
        proven: Whether it is certain that there is none.
        late: Whether the time was over.
    """

    plan: list[int] | None
    proven: bool = False
    late: bool = False


def find_plan(model: TransitionModel, state: Vector, deadline: float) -> Found:
    """Search for a plan to the problem's goal.

    If everything that can be reached is a small graph, its best policy is the plan; else that of
    the neighbourhood of a way that the search for a goal found.

    Args:
        model: A model without processes and chance.
        state: `[F]` where to start.
        deadline: Value of `time.monotonic` at which the search ends; it is looked at now and then.
    """
    if model.ground.goal is None or model.at_goal(state):
        return Found([])
    graph = ClosedGraph(model, _SETTINGS)
    search = GoalSearch(model, _SETTINGS)
    limit = _SMALL
    while True:
        if time.monotonic() > deadline:
            return Found(None, late=True)
        if limit <= MAX_EDGES and not graph.spreads:
            graph.grow(state, limit)
            if graph.complete:
                plan = _followed(model, graph, state)
                return Found(plan, proven=plan is None and exact(model) and graph.largest < 2.0**53)
        if time.monotonic() > deadline:
            return Found(None, late=True)
        way = search.way(state, limit)
        if way is not None:
            neighbourhood = ClosedGraph(model, _SETTINGS)
            neighbourhood.grow(way, _SMALL)
            return Found(_followed(model, neighbourhood, state) or _retraced(model, state, way))
        if search.steps < limit or limit >= _MOST:  # nothing is left, or no memory
            return Found(None)
        limit *= _GROWTH


def _followed(model: TransitionModel, graph: ClosedGraph, state: Vector) -> list[int] | None:
    """Return the plan that the policy of a graph makes; None where it misses the goal."""
    plan: list[int] = []
    met: set[bytes] = set()
    while state.tobytes() not in met:
        met.add(state.tobytes())
        found = graph.forecast(state)
        if found is None or found.choice < 0:
            return None
        plan.append(found.choice)
        state = model.step(state, found.choice).state
        if model.at_goal(state):
            return plan
    return None


def _retraced(model: TransitionModel, start: Vector, way: Vector) -> list[int] | None:
    """Return the actions that lead along the states of a way, and from the last to the goal."""
    everything = np.arange(len(model.actions))
    matters = np.ones(len(model.fluents), dtype=np.bool_)
    matters[inert_fluents(model)] = False  # the way leaves these out
    plan: list[int] = []
    state = start
    for target in (*way[1:], None):
        after = model.step(np.repeat(state[None], len(everything), axis=0), everything)
        if target is None:
            fits = after.terminal & (after.reward > 0.0)
        else:
            fits = (after.state == target)[:, matters].all(axis=1)
        fitting = np.flatnonzero(after.applicable & fits)
        if not fitting.size:
            return None
        plan.append(int(fitting[0]))
        state = after.state[plan[-1]]
    return plan if model.at_goal(state) else None


def exact(model: TransitionModel) -> bool:
    """Return whether floating-point numbers are those of exact arithmetic.

    They are where whole numbers are added, and multiplied by constants.
    """
    numbers = [
        *model.theta.tolist(),
        *(model.initial_state if model.initial_state is not None else ()),
    ]
    return all(float(n).is_integer() for n in numbers) and all(map(_whole, _values(model.ground)))


def _values(ground: g.GroundModel) -> Iterator[g.Value]:
    for schema in ground.schemas:
        tests = [*schema.preconditions, *(effect.condition for effect in schema.effects)]
        for comparison in (c for test in tests for c in g.comparisons_of(test)):
            yield from (comparison.left, comparison.right)
        for effect in schema.effects:
            if isinstance(effect, g.SetNumber):
                scales = effect.change in (Change.SCALE_UP, Change.SCALE_DOWN)
                yield g.Operation("/", effect.value, effect.value) if scales else effect.value
    for comparison in g.comparisons_of(ground.goal) if ground.goal is not None else ():
        yield from (comparison.left, comparison.right)


def _whole(value: g.Value) -> bool:
    match value:
        case g.Operation(operator, left, right):
            product = (
                operator == "*"
                and any(True for _ in g.fluents_of(left))
                and any(True for _ in g.fluents_of(right))
            )
            kept = operator not in ("/", "atan2") and not product
            return kept and _whole(left) and _whole(right)
        case g.Unary(operator, operand):
            return operator in ("-", "abs") and _whole(operand)
        case _:
            return True
