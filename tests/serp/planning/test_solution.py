"""Lexicographic value iteration with slack, and what it shows of every action."""

from random import Random
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from serp import _core
from serp.agent.registry import far_sight
from serp.model.flags import APPLICABLE, UNSAFE
from serp.planning.forecast import forecast_of, score_of
from serp.planning.preference import free_of_risk, rank_of
from serp.settings import PlannerSettings
from tests.generated.profile import examples
from tests.serp.planning.worlds import load
from tests.worlds import text

ENDED = -1
UNTIL_END = 2
ACTIONS = 3
CLOSE = 1e-6
ALIKE = 1e-7
"""Values that differ by less than this fraction of the largest are equal."""
MODEL = load(
    "(define (domain three) (:functions (x))"
    + "".join(
        f"(:action a{k} :parameters () :precondition (and) :effect (and))" for k in range(ACTIONS)
    )
    + ")"
)
"""A model with the fluents and actions of the processes; its steps do not matter."""
SLACK = st.sampled_from((0.01, 0.05, 0.3, 0.9))
DISCOUNT = st.sampled_from((0.5, 0.9, 0.99))


class Out(NamedTuple):
    """An edge of a small decision process: outcomes are (probability, node)."""

    flags: int
    step_risk: float
    reward: float
    outcomes: list[tuple[float, int]]


def process(random, *, chance):
    """Some nodes with up to three edges each; without chance one outcome, and no risk but 1."""
    nodes = random.randint(2, 8)

    def out():
        count = random.randint(1, 3) if chance else 1
        weights = [random.random() + 0.01 for _ in range(count)]
        flags, step_risk = random.choice(((APPLICABLE, 0.0),) * 4 + ((APPLICABLE | UNSAFE, 1.0),))
        if chance and step_risk == 0.0 and random.random() < 0.3:
            step_risk = random.choice((random.random(), 1.0))
        targets = [(w / sum(weights), random.randint(ENDED, nodes - 1)) for w in weights]
        return Out(flags, step_risk, random.uniform(-1, 1), targets)

    return [[out() for _ in range(random.randint(0, ACTIONS))] for _ in range(nodes)]


class Solved(NamedTuple):
    """Columns of a graph, those of `serp/planning/graph.hpp`, and what a saved one shows."""

    columns: dict[str, NDArray[Any]]
    graph: _core.ClosedGraph

    def __getattr__(self, name):
        return self.columns[name]

    def look_up(self, node):
        """The forecast for the node whose state is its number."""
        fields = self.graph.look_up(np.array([float(node)]))
        return forecast_of(fields)


def solved(of, discount, accepted):
    """The process as a closed graph, solved."""
    edges = [edge for node in of for edge in node]
    outcomes = [outcome for edge in edges for outcome in edge.outcomes]
    nodes, zeros = len(of), np.zeros(len(of))
    marks = np.zeros(nodes, np.uint8)
    graph = _core.ClosedGraph(MODEL.core, discount, accepted)
    graph.restore({
        "states": np.arange(float(nodes)), "layer": np.zeros(nodes, np.int32),
        "undefined": marks, "value": zeros, "risk": zeros, "steps": np.zeros(nodes, np.int64),
        "inside": marks, "slack": marks, "risk_kind": np.zeros(1, np.uint8),
        "first_edge": np.cumsum([0, *map(len, of)]),
        "action": np.array([k for node in of for k in range(len(node))], np.int32),
        "flags": np.array([edge.flags for edge in edges], np.int64),
        "reward": np.array([edge.reward for edge in edges], np.float64),
        "step_risk": np.array([edge.step_risk for edge in edges], np.float64),
        "going_on": np.ones(len(edges)),
        "first_outcome": np.cumsum([0, *(len(edge.outcomes) for edge in edges)]),
        "target": np.array([target for _, target in outcomes], np.int32),
        "chance": np.array([share for share, _ in outcomes], np.float64),
        "inert": np.zeros(0, np.int64),
    })  # fmt: skip
    graph.solve()
    return Solved(graph.columns(), graph)


def after(edge, values):
    return sum(share * values[target] for share, target in edge.outcomes if target != ENDED)


def risk_after(edge, risks, discount):
    return edge.step_risk + (1.0 - edge.step_risk) * discount * after(edge, risks)


def discount_of_risk(graph, discount):
    """Risks are not discounted where the rewards lead to the end of the task."""
    return 1.0 if graph.risk_kind[0] == UNTIL_END else discount


def risks_of_policy(of, choice, discount):
    risks = [0.0] * len(of)
    for _ in range(3_000):
        risks = [risk_after(e, risks, discount) if e else 0.0 for e in choice]
    return risks


@examples(80)
@given(seed=st.integers(0, 10**6), accepted=SLACK, discount=DISCOUNT)
def test_a_policy_risks_no_more_than_the_least_and_what_is_accepted(seed, accepted, discount):
    of = process(Random(seed), chance=True)
    strict, graph = solved(of, discount, 0.0), solved(of, discount, accepted)
    assert graph.risk.tolist() == strict.risk.tolist()
    assert (graph.value >= strict.value - CLOSE).all()
    choice = [arcs[graph.look_up(node).choice] if arcs else None for node, arcs in enumerate(of)]
    ranks = [min((rank_of(e.flags) for e in node), default=0) for node in of]
    assert all(e is None or rank_of(e.flags) == r for e, r in zip(choice, ranks, strict=True))
    discount = discount_of_risk(graph, discount)
    met = np.array(risks_of_policy(of, choice, discount))
    assert (met <= graph.risk + accepted + CLOSE).all()
    for edge, least in zip(choice, graph.risk.tolist(), strict=True):
        if edge is not None:
            own = risk_after(edge, graph.risk.tolist(), discount)
            assert own <= least + accepted + CLOSE


@examples(80)
@given(seed=st.integers(0, 10**6), accepted=SLACK, discount=DISCOUNT)
def test_what_is_certain_is_never_accepted(seed, accepted, discount):
    of = process(Random(seed), chance=False)
    strict, graph = solved(of, discount, 0.0), solved(of, discount, accepted)
    for name in ("value", "risk", "steps", "inside"):
        assert getattr(graph, name).tobytes() == getattr(strict, name).tobytes(), name
    for node in range(len(of)):
        assert _looked_up(strict, node) == _looked_up(graph, node)


def _looked_up(graph, node):
    shown = graph.look_up(node)
    return shown.choice, shown.value.tolist(), shown.path_risk.tolist(), shown.safe_steps.tolist()


@examples(100)
@given(seed=st.integers(0, 10**6), discount=DISCOUNT, chance=st.booleans())
def test_what_is_shown_is_one_step_and_then_the_best_policy(seed, discount, chance):
    of = process(Random(seed), chance=chance)
    graph = solved(of, discount, 0.0)
    alike = 10 * ALIKE * max(1.0, float(np.abs(graph.value).max()))
    for node, arcs in enumerate(of):
        forecast = graph.look_up(node)
        for action, edge in enumerate(arcs):
            value = edge.reward + discount * after(edge, graph.value.tolist())
            assert abs(forecast.value[action] - value) <= alike
            risk = risk_after(edge, graph.risk.tolist(), discount_of_risk(graph, discount))
            assert abs(forecast.path_risk[action] - risk) <= 10 * ALIKE
        if arcs:
            best = max(range(len(arcs)), key=lambda a: (score_of(forecast, a), -a))
            assert forecast.choice == best
            assert abs(forecast.path_risk[best] - graph.risk[node]) <= 10 * ALIKE
            if graph.risk[node] == 0.0:
                assert abs(forecast.value[best] - graph.value[node]) <= alike


@pytest.mark.parametrize("accepted", [0.0, 0.02])
def test_a_task_is_not_put_off_for_ever_for_its_risk(accepted):
    """Where the rewards want its end, what is risked until then counts."""
    wait, cross = (
        Out(APPLICABLE, risk, reward, [(1.0, target)])
        for risk, reward, target in ((0.0, -0.1, 0), (0.1, 10.0, ENDED))
    )
    forecast = solved([[wait, cross]], 0.99, accepted).look_up(0)
    assert forecast.choice == 1 and forecast.path_risk[1] == pytest.approx(0.1)
    assert free_of_risk(forecast.flags)[:2].all()  # to wait once is no damage, either
    forecast = solved([[wait._replace(reward=1.0), cross]], 0.99, accepted).look_up(0)
    assert forecast.choice == 0 and free_of_risk(forecast.flags).tolist()[:2] == [True, False]


WAITING = text("waiting")


@pytest.mark.parametrize("discount", [0.99, 1.0])
def test_waiting_is_worth_what_it_can_lead_to_and_is_not_chosen(discount):
    model = load(WAITING)
    planner = far_sight(model, PlannerSettings(discount=discount))
    state = np.zeros(1)
    for name, worth in (("open", 10 * discount), ("leave", 10.0)):
        forecast = planner.forecast(state)
        assert model.actions[forecast.choice].name == name and not forecast.indifferent
        assert forecast.value[forecast.choice] == pytest.approx(worth, abs=CLOSE)
        assert forecast.value[0] == pytest.approx(discount * worth, abs=CLOSE)
        state = model.step(state, forecast.choice).state


@pytest.mark.parametrize(("danger", "discount"), [(1e-5, 0.9999), (2.0**-22, 1.0), (1e-4, 1.0)])
def test_every_node_has_a_best_action_where_sweeps_do_not_suffice(danger, discount):
    of = [[Out(APPLICABLE, danger, 1.0, [(1.0, 1 - node)])] for node in range(2)]
    graph = solved(of, discount, 0.05)
    assert np.isfinite(graph.value).all() and (graph.steps == 0).all()
    assert np.isfinite(graph.look_up(0).value[0])


def test_no_risk_exceeds_1_by_rounding():
    """A graph with such a risk could be saved, and not be restored."""
    for seed in range(16):
        random = Random(seed)
        weights = [random.random() for _ in range(3)]
        shares, danger = [w / sum(weights) for w in weights], random.random()
        end = Out(APPLICABLE, 0.0, 5.0, [(1.0, ENDED)])
        lost = [
            Out(APPLICABLE, danger, 0.0, list(zip(shares, targets, strict=True)))
            for targets in ((1, 2, 2), (2, 1, 1))
        ]
        graph = solved(
            [[end], *([edge] for edge in lost), [end._replace(step_risk=1e-3)]], 1.0, 0.0
        )
        assert (graph.risk <= 1.0).all()
        graph.graph.restore(graph.columns)
