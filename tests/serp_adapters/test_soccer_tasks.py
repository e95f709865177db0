"""What both soccer tasks share: sound fluents, one unsafe action."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from serp.agent.arbiter import Arbiter
from serp.agent.registry import make_planner
from serp.settings import resolve
from serp.tasks.task import BoundTask
from serp_adapters.soccer import corner_kick, defender
from serp_envs.soccer.contest import Contest
from serp_envs.soccer.corner_kick import CornerKick
from serp_envs.soccer.fields import SPL_2020

Point = tuple[float, float]
Vector = NDArray[np.float64]


class Kind(NamedTuple):
    """A task: its module, its observations, its unsafe action, its fluents of the moment."""

    module: ModuleType
    space: Any
    charge: int
    momentary: tuple[int, ...]


KINDS = {
    "soccer": Kind(defender, Contest(SPL_2020).observation_space, 4, (4, 5)),
    "corner-kick": Kind(corner_kick, CornerKick(SPL_2020).observation_space, 5, (1,)),
}


def play(task: BoundTask, act: Callable[[Any], int], decisions: int) -> Vector:
    """Return the observations of so many decisions."""
    seen = []
    raw, _ = task.reset(seed=1)
    for _ in range(decisions):
        seen.append(raw)
        raw, _, terminated, truncated, _ = task.step(act(raw))
        if terminated or truncated:
            raw, _ = task.reset()
    return np.array(seen, dtype=np.float64)


def planner_of(task: BoundTask) -> Arbiter:
    chosen = resolve("default", task.task.settings)
    return Arbiter(make_planner(task.model, chosen.planner), task.actions, chosen.arbiter)


@pytest.fixture(scope="module", params=KINDS)
def kind(request: pytest.FixtureRequest) -> Kind:
    return KINDS[request.param]


@pytest.fixture(scope="module")
def task(kind: Kind) -> BoundTask:
    bound: BoundTask = kind.module.task().bind()
    return bound


@pytest.fixture(scope="module")
def seen(task: BoundTask) -> Vector:
    """Of random actions, charges and falls included."""
    rng = np.random.default_rng(5)
    return play(task, lambda raw: int(rng.integers(task.actions.size)), 1200)


# Grounding


def test_a_batch_grounds_like_its_rows(kind: Kind, seen: Vector) -> None:
    batch = kind.module.ground(seen)
    np.testing.assert_array_equal(batch, [kind.module.ground(row) for row in seen])
    stacked = kind.module.ground(seen[:12].reshape(3, 4, -1))
    np.testing.assert_array_equal(stacked, batch[:12].reshape(3, 4, -1))
    assert not batch[:, kind.momentary].any()  # they last within a step only


@pytest.mark.parametrize("name", KINDS)
@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_every_fluent_of_any_observation_is_finite_and_no_less_than_0(
    name: str, data: st.DataObject
) -> None:
    kind = KINDS[name]
    bounds = zip(kind.space.low.tolist(), kind.space.high.tolist(), strict=True)
    values = data.draw(st.tuples(*(st.floats(low, high, width=32) for low, high in bounds)))
    grounded = kind.module.ground(np.array(values, dtype=np.float32))
    assert np.isfinite(grounded).all()
    assert (grounded >= 0.0).all()


# Domain and planner


def test_the_charge_alone_is_unsafe_wherever_it_is_chosen(
    kind: Kind, task: BoundTask, seen: Vector
) -> None:
    arbiter = planner_of(task)
    for state in kind.module.ground(seen[::20]):
        forecast = arbiter.forecast(state)
        assert forecast.safe.tolist() == [True] * kind.charge + [False]
        assert not arbiter.vetoes.admissible(forecast)[kind.charge]
        assert arbiter.plan(state).action != kind.charge
