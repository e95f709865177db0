"""The soccer tasks: sound fluents, one unsafe action, and the planner's choice in situations."""

from math import asin, atan2, hypot
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.agent.arbiter import Arbiter
from serp.agent.registry import make_planner
from serp.settings import resolve
from serp_adapters.soccer import corner_kick, defender
from serp_envs.soccer.contest import Contest
from serp_envs.soccer.corner_kick import CornerKick
from serp_envs.soccer.fields import SPL_2020


class Kind(NamedTuple):
    """A task: its module, its observations, its unsafe action."""

    module: ModuleType
    space: Any
    charge: int


KINDS = {
    "soccer": Kind(defender, Contest(SPL_2020).observation_space, 4),
    "corner-kick": Kind(corner_kick, CornerKick(SPL_2020).observation_space, 5),
}


def play(task, act, decisions):
    """Return the observations of so many decisions."""
    seen = []
    raw, _ = task.reset(seed=1)
    for _ in range(decisions):
        seen.append(raw)
        raw, _, terminated, truncated, _ = task.step(act(raw))
        if terminated or truncated:
            raw, _ = task.reset()
    return np.array(seen, dtype=np.float64)


def planner_of(task):
    chosen = resolve("default", task.task.settings)
    return Arbiter(make_planner(task.model, chosen.planner), task.actions, chosen.arbiter)


@pytest.fixture(scope="module", params=KINDS)
def kind(request):
    return KINDS[request.param]


@pytest.fixture(scope="module")
def task(kind):
    return kind.module.task().bind()


@pytest.fixture(scope="module")
def seen(task):
    """Of random actions, charges and falls included."""
    rng = np.random.default_rng(5)
    return play(task, lambda raw: int(rng.integers(task.actions.size)), 1200)


@pytest.mark.parametrize("name", KINDS)
@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_every_fluent_of_any_observation_is_finite_and_no_less_than_0(name, data):
    kind = KINDS[name]
    bounds = zip(kind.space.low.tolist(), kind.space.high.tolist(), strict=True)
    values = data.draw(st.tuples(*(st.floats(low, high, width=32) for low, high in bounds)))
    grounded = kind.module.ground(np.array(values, dtype=np.float32))
    assert np.isfinite(grounded).all()
    assert (grounded >= 0.0).all()


def test_the_charge_alone_is_unsafe_wherever_it_is_chosen(kind, task, seen):
    arbiter = planner_of(task)
    for state in kind.module.ground(seen[::20]):
        forecast = arbiter.forecast(state)
        assert forecast.safe.tolist() == [True] * kind.charge + [False]
        assert not arbiter.vetoes.admissible(forecast)[kind.charge]
        assert arbiter.plan(state).action != kind.charge


@pytest.fixture(scope="module")
def pitch():
    return defender.task().bind()


def test_grounding_agrees_with_the_poses_of_info(pitch):
    names = [f.name for f in pitch.model.fluents]
    raw, info = pitch.reset(seed=9)
    for _ in range(30):
        values = dict(zip(names, defender.ground(raw).tolist(), strict=True))
        ball = np.array((info["ball_x"], info["ball_y"]))
        robot = np.array((info["defender_x"], info["defender_y"])) - ball
        opponent = np.array((info["attacker_x"], info["attacker_y"])) - ball
        goal = np.array((-4.5, 0.0)) - ball
        cosine = robot @ goal / (hypot(*robot) * hypot(*goal))
        half = atan2(0.75, hypot(*goal))
        shadow = asin(0.2 / max(0.2, hypot(*robot)))
        share = min(1.0, max(0.0, (np.arccos(cosine) + half - shadow) / (2 * half)))
        assert values["robot-to-ball"] == pytest.approx(hypot(*robot), abs=1e-5)
        assert values["opponent-to-ball"] == pytest.approx(hypot(*opponent), abs=1e-5)
        assert values["robot-to-opponent"] == pytest.approx(hypot(*(robot - opponent)), abs=1e-5)
        assert values["off-line"] == pytest.approx(np.arccos(cosine), abs=1e-3)
        assert values["goal-open"] == pytest.approx(share, abs=2e-3)
        assert values["in-range"] == (hypot(*goal) < 3.0)
        raw, _, terminated, truncated, info = pitch.step(0)
        if terminated or truncated:
            raw, info = pitch.reset()
