"""The closed planning graph finds the best policy of a finite task, and keeps it."""

from random import Random

import numpy as np
import pytest

from serp.agent.registry import far_sight
from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED
from serp.planning.closed_graph import ClosedGraph
from serp.planning.inert import inert_fluents
from serp.planning.lookahead import Lookahead
from serp.planning.preference import marked, rank_of, step_risk
from serp.settings import PlannerSettings
from tests.serp.planning import worlds
from tests.worlds import text

SETTINGS = PlannerSettings(discount=0.9)
MOST = 400
"""States of a finite world, at most."""
EXACT = 1e-6

ENDLESS = text("endless")


def reachable(model, root):
    """All states that can be reached, found one by one; None if there are more than `MOST`."""
    known, position = [root], 0
    seen = {root}
    while position < len(known):
        state = list(known[position])
        position += 1
        for action in range(len(model.actions)):
            out, flags = model.transition(state, action)
            target = tuple(out[:-1])
            if flags & APPLICABLE and not flags & TERMINAL and target not in seen:
                seen.add(target)
                known.append(target)
        if len(known) > MOST:
            return None
    return known


def best_values(model, states):
    """Risks and values of all states, by sweeps over every state and action in plain Python."""
    where = {state: k for k, state in enumerate(states)}
    discount, accepted = SETTINGS.discount, SETTINGS.accepted_risk
    edges = []
    risk, value = np.zeros((2, len(states)))
    fixed = np.zeros(len(states), dtype=bool)
    for k, state in enumerate(states):
        found = []
        undefined = False
        for action in range(len(model.actions)):
            out, flags = model.transition(list(state), action)
            if not flags & APPLICABLE:
                undefined |= bool(flags & UNDEFINED)
                continue
            danger = step_risk(flags, accepted)
            target = -1 if flags & TERMINAL else where[tuple(out[:-1])]
            found.append((rank_of(marked(flags, danger)), danger, out[-1], target))
        least = min((rank for rank, *_ in found), default=0)
        edges.append([rest for rank, *rest in found if rank == least])
        if not found:
            risk[k], fixed[k] = float(undefined), True

    def sweep(of, one, choose):
        for _ in range(2_000):
            old = of.copy()
            for k, out in enumerate(edges):
                if not fixed[k]:
                    of[k] = choose(one(edge) for edge in out)
            if np.abs(of - old).max(initial=0.0) < 1e-12:
                return

    def risk_of(edge):
        danger, _, target = edge
        return danger + (1.0 - danger) * discount * (risk[target] if target >= 0 else 0.0)

    sweep(risk, risk_of, min)
    for k, out in enumerate(edges):
        edges[k] = [edge for edge in out if risk_of(edge) <= risk[k] + 1e-7]
    sweep(value, lambda e: e[1] + discount * (value[e[2]] if e[2] >= 0 else 0.0), max)
    return risk, value


@pytest.mark.parametrize("seed", range(worlds.WORLDS))
def test_values_and_risks_are_those_of_plain_sweeps(seed):
    model = worlds.world(seed)
    for start in worlds.states_of(model, Random(seed), 5):
        states = reachable(model, tuple(start.tolist()))
        if states is None:
            continue
        graph = ClosedGraph(model, SETTINGS)
        graph.grow(start)
        different = np.delete(np.array(states), inert_fluents(model), axis=1)
        assert graph.complete and graph.nodes == len(np.unique(different, axis=0))
        risk, value = best_values(model, states)
        for k, state in enumerate(states):
            forecast = graph.forecast(np.array(state))
            if forecast.choice >= 0:
                assert forecast.path_risk[forecast.choice] == pytest.approx(risk[k], abs=EXACT)
                assert forecast.value[forecast.choice] == pytest.approx(
                    value[k], abs=EXACT, rel=1e-5
                )


@pytest.mark.parametrize("seed", range(worlds.WORLDS))
def test_what_one_step_predicts_is_what_the_lookahead_predicts(seed):
    model = worlds.world(seed)
    for start in worlds.states_of(model, Random(seed), 5):
        graph = ClosedGraph(model, SETTINGS)
        graph.grow(start, 600)
        found, near = graph.forecast(start), Lookahead(model, SETTINGS).forecast(start)
        if found is not None:
            assert found.flags.tolist() == near.flags.tolist()
            assert found.reward.tolist() == near.reward.tolist()


def test_what_never_closes_is_left_to_the_lookahead_in_bounded_memory():
    model = worlds.load(ENDLESS)
    graph = ClosedGraph(model, SETTINGS)
    graph.grow(np.zeros(2))
    assert not graph.complete and graph.edges < 4_000 and graph.forecast(np.zeros(2)) is None
    forecast = far_sight(model, SETTINGS).forecast(np.zeros(2))
    near = Lookahead(model, SETTINGS).forecast(np.zeros(2))
    assert forecast.choice == near.choice and (forecast.value == near.value).all()
