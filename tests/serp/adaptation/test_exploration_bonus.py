from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.adaptation.exploration_bonus import ExplorationBonus
from serp.model.flags import APPLICABLE, RISKY, TERMINAL, UNDEFINED, UNSAFE
from serp.model.transition_model import TransitionModel
from serp.planning.forecast import SAFE, Forecast
from serp.planning.limits import Bound
from serp.planning.lookahead import Lookahead
from serp.settings import PlannerSettings
from tests.generated.profile import examples
from tests.serp.sysid import worlds

TRIES = 3
FLAGS = (
    APPLICABLE, APPLICABLE | TERMINAL, APPLICABLE | UNSAFE, APPLICABLE | RISKY, 0, UNDEFINED,
)  # fmt: skip


def forecast_of(flags: list[int], steps: list[int], choice: int) -> Forecast:
    actions = len(flags)
    return Forecast(
        choice, np.arange(actions, dtype=float), (np.array(steps) != SAFE).astype(float),
        np.array(steps), np.zeros(actions), np.array(flags), 3, Bound.DEPTH,
    )  # fmt: skip


@st.composite
def situations(draw: st.DrawFn) -> tuple[Forecast, list[int]]:
    """Forecasts whose choice is unsafe only where nothing is predicted safe, and counts."""
    actions = draw(st.integers(1, 5))
    flags = draw(st.lists(st.sampled_from(FLAGS), min_size=actions, max_size=actions))
    steps = [
        -1
        if not f & APPLICABLE
        else 0
        if f & (UNSAFE | RISKY)
        else draw(st.sampled_from((1, 2, SAFE)))
        for f in flags
    ]
    best = max(range(actions), key=lambda k: (steps[k], k))
    choice = best if steps[best] >= 0 else -1
    tried = draw(st.lists(st.integers(0, TRIES + 1), min_size=actions, max_size=actions))
    return forecast_of(flags, steps, choice), tried


@given(situation=situations())
@examples(400)
def test_what_is_tried_is_the_least_known_that_is_safe(
    situation: tuple[Forecast, list[int]],
) -> None:
    planned, tried = situation
    told = ExplorationBonus(np.array(tried), TRIES)(planned)
    for ours, theirs in zip(told[1:], planned[1:], strict=True):
        assert ours is theirs
    if told.choice == planned.choice:
        return
    chosen = told.choice
    assert tried[chosen] < TRIES
    assert told.flags[chosen] & (APPLICABLE | UNSAFE | RISKY | UNDEFINED) == APPLICABLE
    if planned.safe:
        assert told.safe  # where something is safe for the whole lookahead, so is what is tried
    alike = [
        k
        for k in range(len(tried))
        if told.flags[k] & (APPLICABLE | UNSAFE | RISKY | UNDEFINED) == APPLICABLE
        and (told.safe_steps[k] == SAFE or not (told.safe_steps == SAFE).any())
    ]
    assert tried[chosen] == min(tried[k] for k in alike)
    assert chosen == min(k for k in alike if tried[k] == tried[chosen])


@given(situation=situations())
@examples(100)
def test_what_is_known_is_left_to_the_planner(situation: tuple[Forecast, list[int]]) -> None:
    planned, tried = situation
    for known in (np.full(len(tried), TRIES), np.array(tried) + TRIES):
        assert ExplorationBonus(known, TRIES)(planned) is planned
    assert ExplorationBonus(np.array(tried), 0)(planned) is planned


def test_an_action_little_known_that_is_predicted_harmful_is_not_tried() -> None:
    flags = [APPLICABLE, APPLICABLE | UNSAFE, APPLICABLE, 0, UNDEFINED]
    planned = forecast_of(flags, [SAFE, 0, 2, -1, -1], 0)
    assert ExplorationBonus(np.array([9, 0, 0, 0, 0]), TRIES)(planned) is planned


def test_where_all_that_is_known_leads_to_harm_what_is_not_is_tried() -> None:
    planned = forecast_of([APPLICABLE, APPLICABLE, APPLICABLE | UNSAFE], [2, 1, 0], 0)
    told = ExplorationBonus(np.array([9, 1, 0]), TRIES)(planned)
    assert told.choice == 1


@pytest.fixture
def model() -> TransitionModel:
    return worlds.edge()


def test_every_safe_action_is_tried_so_often_and_then_the_planner_goes_on(
    model: TransitionModel,
) -> None:
    planner = Lookahead(model, PlannerSettings(depth=2))
    tried = np.zeros(len(model.actions), dtype=np.int64)
    curious = ExplorationBonus(tried, TRIES)
    state = model.state({"x": 1.0, "y": 0.0, "wet": False})
    chosen = []
    for _ in range(TRIES * len(tried) + 3):
        choice = curious(planner.forecast(state)).choice
        chosen.append(model.actions[choice].name)
        tried[choice] += 1  # as its owner does: the count is shared
    assert chosen[: TRIES * 3] == ["left", "right", "jump"] * TRIES
    own = model.actions[planner.forecast(state).choice].name
    assert set(chosen[TRIES * 3 :]) == {own}


def test_beside_the_pit_the_way_into_it_is_not_tried(model: TransitionModel) -> None:
    planner = Lookahead(model, PlannerSettings(depth=2))
    state = model.state({"x": -2.0, "y": 0.0, "wet": True})
    told = ExplorationBonus(np.zeros(3, dtype=np.int64), TRIES)(planner.forecast(state))
    assert model.actions[told.choice].name == "right"
