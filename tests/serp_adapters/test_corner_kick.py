"""The corner-kick task: what the grounding says of situations, what the planner makes of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from itertools import pairwise
from math import pi, sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from serp.control.arbiter import Arbiter
from serp.model.transition_model import TransitionModel
from serp.settings import resolve
from serp.tasks.task import BoundTask
from serp.training.agent import make_planner
from serp_adapters.soccer import corner_kick
from serp_envs.soccer.corner_kick import CornerKick
from serp_envs.soccer.fields import SPL_2020
from serp_envs.soccer.rolling import meeting

Point = tuple[float, float]
Vector = NDArray[np.float64]

FLUENTS = 9
CHARGE = 5


@pytest.fixture(scope="module")
def task() -> BoundTask:
    return corner_kick.task().bind()


@pytest.fixture(scope="module")
def model(task: BoundTask) -> TransitionModel:
    return task.model


def play(
    task: BoundTask, act: Callable[[Vector], int], corners: int, seed: int = 1
) -> tuple[Vector, Counter[str], list[Any]]:
    """Play corners. Returns of each, outcomes and other counts, observations."""
    returns, counts, seen = [], Counter[str](), []
    raw, _ = task.reset(seed=seed)
    for corner in range(corners):
        if corner:
            raw, _ = task.reset()
        total, ended = 0.0, False
        while not ended:
            seen.append(raw)
            raw, reward, terminated, truncated, info = task.step(act(raw))
            total += reward
            counts["decisions"] += 1
            ended = terminated or truncated
        seen.append(raw)
        returns.append(total)
        counts[info["outcome"]] += 1
        counts["unsafe"] += info["unsafe_choices"]
    return np.array(returns), counts, seen


@pytest.fixture(scope="module")
def at_random(task: BoundTask) -> tuple[Vector, Counter[str], list[Any]]:
    """500 corners of random actions, charges and falls included."""
    rng = np.random.default_rng(5)
    return play(task, lambda raw: int(rng.integers(6)), 500)


@pytest.fixture(scope="module")
def seen(at_random: tuple[Vector, Counter[str], list[Any]]) -> Vector:
    """Observations of 40 of them, about."""
    return np.array(at_random[2][:1200], dtype=np.float64)


def observation(
    robot: Point,
    opponent: Point,
    ball: Point,
    velocity: Point = (0.0, 0.0),
    *,
    taken: bool = True,
    wind_up: float = 0.0,
) -> Vector:
    """An observation, from places in metres: the goal is at (0, 0), x up the pitch."""
    vector = np.zeros(17)
    vector[0:6] = np.array((*robot, *opponent, *ball)) / 2.0
    vector[6:8] = velocity
    vector[[8, 10]] = -1.0
    vector[12:14] = taken, wind_up
    return vector


def fluents(model: TransitionModel, *places: Any, **options: Any) -> dict[str, float]:
    grounded = corner_kick.ground(observation(*places, **options))
    return dict(zip([f.name for f in model.fluents], grounded.tolist(), strict=True))


# Grounding -------------------------------------------------------------------------------------


def test_distances_are_metres(model: TransitionModel) -> None:
    values = fluents(model, (0.5, 0.0), (1.3, 0.6), (0.8, 0.4))
    assert values["robot-to-ball"] == pytest.approx(0.5)
    assert values["robot-to-opponent"] == pytest.approx(1.0)


def test_the_mark_is_an_arms_length_from_the_opponent_towards_the_goal(
    model: TransitionModel,
) -> None:
    # The opponent 1.5 m from the goal at (0.9, 1.2): the mark is 1.05 m from it, at (0.63, 0.84).
    assert fluents(model, (0.63, 0.84), (0.9, 1.2), (0, 3))["robot-to-mark"] == pytest.approx(0.0)
    assert fluents(model, (0.93, 1.24), (0.9, 1.2), (0, 3))["robot-to-mark"] == pytest.approx(0.5)
    # Nearer to the goal than that, the middle of the goal is the mark.
    assert fluents(model, (0.3, 0.4), (0.3, 0.0), (0, 3))["robot-to-mark"] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("robot", "ball", "velocity", "seconds"),
    [
        ((0.5, 0.0), (0.76, 0.0), (0.0, 0.0), 0.0),  # in reach: nearer than 0.265 m
        ((0.5, 0.0), (1.265, 0.0), (0.0, 0.0), 2.0),  # 0.5 m to walk at 0.25 m/s
        ((0.5, 0.0), (2.265, 0.0), (-0.6, 0.0), 3.6),  # comes 0.6 m in 2 s and stops: 0.9 m to walk
        (
            (0.5, 0.0),
            (0.5, 1.265),
            (0.0, -0.6),
            1.8,
        ),  # after 1.8 s 0.406 m to walk, 1.62 s; before, more
        ((0.5, 0.0), (0.8, 0.0), (0.6, 0.0), 2.54),  # rolls away by 0.6 m: 0.635 m to walk
    ],
)
def test_ball_in_is_the_time_to_the_first_place_where_it_is_met(
    model: TransitionModel, robot: Point, ball: Point, velocity: Point, seconds: float
) -> None:
    found = fluents(model, robot, (2.0, 2.0), ball, velocity)["ball-in"]
    assert found == pytest.approx(seconds)


def test_the_ball_is_met_where_the_environment_sends_the_robots(task: BoundTask) -> None:
    scenario = task.env.unwrapped.scenario
    assert isinstance(scenario, CornerKick)
    task.reset(seed=3)
    rolling = 0
    for _ in range(300):
        world = scenario.world
        for robot in world.robots[:2]:
            found = corner_kick.until_met(
                *np.array((world.ball_x - robot.x, world.ball_y - robot.y)),
                *np.array((world.ball_vx, world.ball_vy)),
                gap=world.contact,
            )
            assert found == pytest.approx(meeting(world, robot)[2])
        rolling += world.ball_vx != 0.0
        _, _, terminated, truncated, _ = task.step(3)
        if terminated or truncated:
            task.reset()
    assert rolling > 100


@pytest.mark.parametrize(
    ("opponent", "wind_up", "seconds"),
    [
        ((1.26, 0.0), 0.0, 0.6),  # behind the ball, in reach: it winds up
        ((1.26, 0.0), 0.5, 0.3),  # half of it is done
        ((1.765, 0.0), 0.0, 2.6),  # 0.5 m to walk before
        ((1.0, 0.26), 0.0, 0.6 + (pi / 2 - 0.3) * 0.3 / 0.2),  # beside it: a quarter turn round it
        ((0.74, 0.0), 0.0, 0.6 + (pi - 0.3) * 0.3 / 0.2),  # on the wrong side
    ],
)
def test_shot_in_is_the_way_to_the_ball_and_round_it_and_the_wind_up(
    model: TransitionModel, opponent: Point, wind_up: float, seconds: float
) -> None:
    values = fluents(model, (0.3, 0.0), opponent, (1.0, 0.0), wind_up=wind_up)
    assert values["shot-in"] == pytest.approx(seconds)


@pytest.mark.parametrize(
    ("robot", "angle"),
    [((0.6, 0.0), 0.0), ((1.0, 0.4), pi / 2), ((1.0, -0.4), pi / 2), ((1.4, 0.0), pi)],
)
def test_off_line_is_the_angle_to_the_goal_whichever_side(
    model: TransitionModel, robot: Point, angle: float
) -> None:
    assert fluents(model, robot, (2.0, 2.0), (1.0, 0.0))["off-line"] == pytest.approx(angle)


@pytest.mark.parametrize(
    ("robot", "ball", "share"),
    [
        ((0.75, 0.0), (0.95, 0.0), 0.0),  # against the ball
        ((1.35, 0.0), (0.95, 0.0), 1.0),  # behind it
        # The ball 0.75 before the goal: 45° to each post, 30° of them in the shadow of a robot 0.4
        # away.
        ((0.35, 0.0), (0.75, 0.0), 15 / 90),
        # Level with the near post at 1.5 m: the goal is a triangle of 45°, and its middle 26.57°
        # off the straight. On the line to it, 0.4 away, a shadow of ± 30°: nothing is left.
        ((1.5 - 0.4 * 1.5 / sqrt(2.8125), 0.75 - 0.4 * 0.75 / sqrt(2.8125)), (1.5, 0.75), 0.0),
        # There, at a right angle to that line: 90 + 22.5 - 30 degrees of 45.
        ((1.5 + 0.4 * 0.75 / sqrt(2.8125), 0.75 - 0.4 * 1.5 / sqrt(2.8125)), (1.5, 0.75), 1.0),
    ],
)
def test_goal_open_is_the_share_outside_the_shadow(
    model: TransitionModel, robot: Point, ball: Point, share: float
) -> None:
    assert fluents(model, robot, (2, 2), ball)["goal-open"] == pytest.approx(share, abs=1e-9)


def test_taken_is_what_the_environment_says(task: BoundTask, model: TransitionModel) -> None:
    names = [f.name for f in model.fluents]
    raw, info = task.reset(seed=2)
    told = set()
    for _ in range(25):
        assert corner_kick.ground(raw)[names.index("taken")] == info["kicked"]
        told.add(info["kicked"])
        raw, _, terminated, truncated, info = task.step(4)
        if terminated or truncated:
            raw, info = task.reset()
    assert told == {True, False}


def test_what_lasts_within_a_step_only_is_false(model: TransitionModel, seen: Vector) -> None:
    names = [f.name for f in model.fluents]
    assert not corner_kick.ground(seen)[:, names.index("kicked")].any()


def test_a_batch_grounds_like_its_rows(seen: Vector) -> None:
    batch = corner_kick.ground(seen)
    assert batch.shape == (len(seen), FLUENTS)
    np.testing.assert_array_equal(batch, [corner_kick.ground(row) for row in seen])
    stacked = corner_kick.ground(seen[:12].reshape(3, 4, 17))
    np.testing.assert_array_equal(stacked, batch[:12].reshape(3, 4, FLUENTS))


def test_every_fluent_of_real_play_is_finite(task: BoundTask, seen: Vector) -> None:
    assert np.isfinite(corner_kick.ground(seen)).all()
    for row in seen[::7].astype(np.float32):
        task.ground(row)  # as training does: raises on what is no state


SPACE = CornerKick(SPL_2020).observation_space
bounds = zip(SPACE.low.tolist(), SPACE.high.tolist(), strict=True)  # type: ignore[attr-defined]
anything = st.tuples(*(st.floats(low, high, width=32) for low, high in bounds))


@settings(max_examples=200, deadline=None)
@given(anything)
def test_every_fluent_of_any_observation_is_finite_and_in_range(values: tuple[float, ...]) -> None:
    grounded = corner_kick.ground(np.array(values, dtype=np.float32))
    assert np.isfinite(grounded).all()
    assert (grounded >= 0.0).all()
    assert set(grounded[:2]) <= {0.0, 1.0}
    assert grounded[7] <= pi
    assert grounded[8] <= 1.0


def test_corners_on_both_sides_ground_alike(task: BoundTask) -> None:
    """The observation is turned to the side of the corner, so there is no side to be told."""
    sides: dict[float, list[Vector]] = {1.0: [], -1.0: []}
    for seed in range(120):
        raw, info = task.reset(seed=seed)
        sides[info["corner"]].append(corner_kick.ground(raw))
    left, right = (np.array(sides[side]) for side in (1.0, -1.0))
    error = np.sqrt(left.var(axis=0) / len(left) + right.var(axis=0) / len(right))
    assert (np.abs(left.mean(axis=0) - right.mean(axis=0)) <= 3.5 * error + 1e-9).all()


# Domain and planner ----------------------------------------------------------------------------


def planner_of(task: BoundTask, preset: str = "default") -> Arbiter:
    chosen = resolve(preset, task.task.settings)
    return Arbiter(make_planner(task.model, chosen.planner), task.actions, chosen.arbiter)


def test_each_action_has_the_meaning_of_the_environment(task: BoundTask) -> None:
    words = task.env.unwrapped.scenario.actions
    assert [task.actions.name(action) for action in range(6)] == list(words)


def test_the_learner_gets_the_rewards_of_the_environment(task: BoundTask) -> None:
    assert task.rewarded_by == "environment"


def test_the_charge_alone_is_unsafe_wherever_it_is_chosen(task: BoundTask, seen: Vector) -> None:
    arbiter = planner_of(task)
    for state in corner_kick.ground(seen[::5]):
        forecast = arbiter.forecast(state)
        assert forecast.safe.tolist() == [True] * CHARGE + [False]
        assert not arbiter.admissible(forecast)[CHARGE]
        assert arbiter.plan(state).action != CHARGE


@pytest.mark.parametrize(
    ("places", "options", "action"),
    [
        # The opponent stands free, the ball lies at the corner.
        (((0.6, -0.5), (1.2, 0.6), (0.05, 2.95)), {"taken": False}, "mark-attacker"),
        # The ball comes across, slower and slower, and will lie a step away.
        (((0.6, 0.0), (1.8, 0.0), (0.6, 1.2), (0.0, -0.6)), {}, "intercept"),
        # It lies in reach, the goal behind the robot.
        (((0.5, 0.0), (1.3, 0.0), (0.75, 0.0)), {}, "clear"),
        # The opponent will shoot before the robot is there, and the goal is open.
        (((0.5, 0.2), (1.45, 0.0), (1.2, 0.0)), {}, "mark-attacker"),
        # The ball is in reach, but from here the robot would kick it into its own goal.
        (((1.0, 0.0), (2.5, 1.5), (0.75, 0.0)), {}, "mark-attacker"),
    ],
)
def test_the_planner_does_what_a_coach_would(
    task: BoundTask, places: tuple[Point, ...], options: dict[str, Any], action: str
) -> None:
    state = corner_kick.ground(observation(*places, **options))
    assert task.actions.name(planner_of(task).plan(state).action) == action


def test_standing_still_is_worse_than_chance_and_the_planner_better_than_one_action(
    task: BoundTask, at_random: tuple[Vector, Counter[str], list[Any]]
) -> None:
    """The bands, three standard errors of 500 corners wide."""
    arbiter = planner_of(task)
    planned, counts, _ = play(task, lambda raw: arbiter.plan(task.ground(raw)).action, 500)
    robots = task.env.unwrapped.scenario

    def stand(raw: Any) -> int:
        robots.world.robots[0].down_until = 10**9
        return 0

    still, _, _ = play(task, stand, 500)
    cleared, _, _ = play(task, lambda raw: 4, 500)  # the best of the fixed actions
    order = [still, at_random[0], cleared, planned]
    for worse, better in pairwise(order):
        error = sqrt((worse.var() + better.var()) / 500)
        assert better.mean() - worse.mean() > 4.0 * error
    assert 5.6 <= planned.mean() <= 7.3
    assert 2.5 <= 100 * counts["goal"] / 500 <= 9.0
    assert 77 <= 100 * (counts["cleared"] + counts["secured"]) / 500 <= 88
    assert counts["unsafe"] == 0


def test_the_papers_preset_counts_games(task: BoundTask) -> None:
    chosen = resolve("paper", task.task.settings).arbiter
    assert (chosen.rho_unit, chosen.rho_increment) == ("game", 0.1)
    _, info = task.reset(seed=1)
    assert isinstance(info[chosen.rho_unit], int)
