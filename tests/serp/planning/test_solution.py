"""Lexicographic value iteration with slack, and what it shows of every action."""

from __future__ import annotations

from random import Random
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.agent.registry import far_sight
from serp.model.flags import APPLICABLE, RISKY, UNSAFE
from serp.planning import value_iteration as solution
from serp.planning.array_graph import ENDED, GraphArrays
from serp.planning.edges import Bound, FirstActions
from serp.planning.forecast import SAFE, Forecast, score_of
from serp.planning.preference import rank_of
from serp.planning.value_iteration import ALIKE, look_up
from serp.settings import PlannerSettings
from tests.generated.profile import examples
from tests.serp.planning.worlds import load

ACTIONS = 3
CLOSE = 1e-6
SLACK = st.sampled_from((0.01, 0.05, 0.3, 0.9))
DISCOUNT = st.sampled_from((0.5, 0.9, 0.99))


class Out(NamedTuple):
    """An edge of a small decision process: outcomes are (probability, node)."""

    flags: int
    step_risk: float
    reward: float
    outcomes: list[tuple[float, int]]


Process = list[list[Out]]


def process(random: Random, *, chance: bool) -> Process:
    """Some nodes with up to three edges each; without chance one outcome, and no risk but 1."""
    nodes = random.randint(2, 8)

    def out() -> Out:
        count = random.randint(1, 3) if chance else 1
        weights = [random.random() + 0.01 for _ in range(count)]
        flags, step_risk = random.choice(((APPLICABLE, 0.0),) * 4 + ((APPLICABLE | UNSAFE, 1.0),))
        if chance and step_risk == 0.0 and random.random() < 0.3:
            flags, step_risk = APPLICABLE | RISKY, random.choice((random.random(), 1.0))
        targets = [(w / sum(weights), random.randint(ENDED, nodes - 1)) for w in weights]
        return Out(flags, step_risk, random.uniform(-1, 1), targets)

    return [[out() for _ in range(random.randint(0, ACTIONS))] for _ in range(nodes)]


def solved(of: Process, discount: float, accepted: float) -> GraphArrays:
    """The process as a closed graph, solved."""
    edges = [edge for node in of for edge in node]
    outcomes = [outcome for edge in edges for outcome in edge.outcomes]
    graph = GraphArrays.allocate(len(of), len(edges) + 1, len(outcomes) + 1, 1)
    graph.counters[:] = len(of), len(of), len(edges), len(outcomes)
    graph.first_edge[:] = np.cumsum([0, *map(len, of)])
    graph.first_outcome[: len(edges) + 1] = np.cumsum([0, *(len(e.outcomes) for e in edges)])
    for k, edge in enumerate(edges):
        graph.flags[k], graph.step_risk[k], graph.reward[k] = edge[:3]
        graph.action[k] = k - graph.first_edge[np.searchsorted(graph.first_edge, k, "right") - 1]
    for k, (share, target) in enumerate(outcomes):
        graph.chance[k], graph.target[k] = share, target
    solution.solve(tuple(graph), discount, accepted)
    return graph


def after(edge: Out, values: list[float]) -> float:
    return sum(share * values[target] for share, target in edge.outcomes if target != ENDED)


def risk_after(edge: Out, risks: list[float], discount: float) -> float:
    return edge.step_risk + (1.0 - edge.step_risk) * discount * after(edge, risks)


def risks_of_policy(of: Process, choice: list[Out | None], discount: float) -> list[float]:
    risks = [0.0] * len(of)
    for _ in range(3_000):
        risks = [risk_after(e, risks, discount) if e else 0.0 for e in choice]
    return risks


@examples(150)
@given(seed=st.integers(0, 10**6), accepted=SLACK, discount=DISCOUNT)
def test_a_policy_risks_no_more_than_the_slack_of_every_decision(
    seed: int, accepted: float, discount: float
) -> None:
    of = process(Random(seed), chance=True)
    strict, graph = solved(of, discount, 0.0), solved(of, discount, accepted)
    assert graph.risk.tolist() == strict.risk.tolist()
    assert (graph.value >= strict.value - CLOSE).all()
    edges = [edge for node in of for edge in node]
    choice = [edges[best] if best >= 0 else None for best in graph.best.tolist()]
    ranks = [min((rank_of(e.flags) for e in node), default=0) for node in of]
    assert all(e is None or rank_of(e.flags) == r for e, r in zip(choice, ranks, strict=True))
    met = np.array(risks_of_policy(of, choice, discount))
    assert (met <= graph.risk + accepted / (1.0 - discount) + CLOSE).all()
    for edge, least in zip(choice, graph.risk.tolist(), strict=True):
        if edge is not None:
            own = risk_after(edge, graph.risk.tolist(), discount)
            assert own <= least + accepted + CLOSE


@examples(150)
@given(seed=st.integers(0, 10**6), accepted=SLACK, discount=DISCOUNT)
def test_what_is_certain_is_never_accepted(seed: int, accepted: float, discount: float) -> None:
    of = process(Random(seed), chance=False)
    strict, graph = solved(of, discount, 0.0), solved(of, discount, accepted)
    for name in ("value", "risk", "steps", "best", "inside"):
        assert getattr(graph, name).tobytes() == getattr(strict, name).tobytes(), name
    for node in range(len(of)):
        here = [
            _looked_up(each, node, discount, r) for each, r in ((strict, 0.0), (graph, accepted))
        ]
        assert here[0] == here[1]


@examples(150)
@given(seed=st.integers(0, 10**6), accepted=SLACK, discount=DISCOUNT)
def test_a_decision_is_that_of_the_policy_and_counts_what_is_accepted_as_the_least(
    seed: int, accepted: float, discount: float
) -> None:
    of = process(Random(seed), chance=True)
    graph = solved(of, discount, accepted)
    for node, out in enumerate(of):
        if not out:
            continue
        choice, value, risk, steps = _looked_up(graph, node, discount, accepted)
        assert choice == int(graph.action[graph.best[node]])
        assert risk[choice] == pytest.approx(float(graph.risk[node]), abs=CLOSE)
        same = [
            k for k, edge in enumerate(out) if rank_of(edge.flags) == rank_of(out[choice].flags)
        ]
        best = max((-risk[k], steps[k], value[k]) for k in same)
        assert (-risk[choice], steps[choice], value[choice]) == best
        assert all(steps[k] == SAFE for k in same if risk[k] == 0.0)


def _looked_up(
    graph: GraphArrays, node: int, discount: float, accepted: float
) -> tuple[int, list[float], list[float], list[int]]:
    found = FirstActions.allocate(ACTIONS)
    choice = solution.look_up(tuple(graph), node, (discount, accepted), 0.0, tuple(found))
    return int(choice), *(column.tolist() for column in found[:3])  # type: ignore[return-value]


@examples(200)
@given(seed=st.integers(0, 10**6), discount=DISCOUNT, chance=st.booleans())
def test_what_is_shown_is_one_step_and_then_the_best_policy(
    seed: int, discount: float, chance: bool
) -> None:
    of = process(Random(seed), chance=chance)
    graph = solved(of, discount, 0.0)
    alike = 10 * ALIKE * max(1.0, float(np.abs(graph.value).max()))
    for node, arcs in enumerate(of):
        found = FirstActions.allocate(ACTIONS)
        unit = ALIKE * float(np.abs(graph.value).max())
        choice = look_up(tuple(graph), node, (discount, 0.0), unit, tuple(found))
        forecast = Forecast(choice, *found, 0, Bound.EXHAUSTED)
        for action, edge in enumerate(arcs):
            value = edge.reward + discount * after(edge, graph.value.tolist())
            assert abs(forecast.value[action] - value) <= alike
            risk = risk_after(edge, graph.risk.tolist(), discount)
            assert abs(forecast.path_risk[action] - risk) <= 10 * ALIKE
        if arcs:
            best = max(range(len(arcs)), key=lambda a: (score_of(forecast, a), -a))
            assert forecast.choice == best
            assert abs(forecast.path_risk[best] - graph.risk[node]) <= 10 * ALIKE
            if graph.risk[node] == 0.0:
                assert abs(forecast.value[best] - graph.value[node]) <= alike


WAITING = """
(define (domain waiting)
  (:predicates (open) (terminal))
  (:functions (reward))
  (:action wait :parameters () :precondition (and) :effect (and))
  (:action open :parameters () :precondition (and) :effect (and (open)))
  (:action leave :parameters () :precondition (and (open))
    :effect (and (increase (reward) 10) (terminal))))
"""


@pytest.mark.parametrize("discount", [0.99, 1.0])
def test_waiting_is_worth_what_it_can_lead_to_and_is_not_chosen(discount: float) -> None:
    model = load(WAITING)
    planner = far_sight(model, PlannerSettings(discount=discount))
    state = np.zeros(1)
    for name, worth in (("open", 10 * discount), ("leave", 10.0)):
        forecast = planner.forecast(state)
        assert model.actions[forecast.choice].name == name and not forecast.indifferent
        assert forecast.value[forecast.choice] == pytest.approx(worth, abs=CLOSE)
        assert forecast.value[0] == pytest.approx(discount * worth, abs=CLOSE)
        state = model.step(state, forecast.choice).state
