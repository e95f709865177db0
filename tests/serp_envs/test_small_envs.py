"""Hill, landing and swing-up: their physics, their ends, and that they can be solved."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp_envs import Hill, Landing, SwingUp, hill, landing, swing_up
from serp_envs.landing import PAD, REACH, SOFT
from tests.serp_envs.common import returns


def fine(state: Any, slope: Callable[[np.ndarray], np.ndarray], seconds: float) -> np.ndarray:
    """Integrate an equation of motion, positions and then velocities, in 1,000 steps."""
    values = np.array(state)
    for _ in range(1_000):
        middle = values + seconds / 2_000 * slope(values)
        values = values + seconds / 1_000 * slope(middle)
    return values


@given(x=st.floats(-1.5, 1.0), v=st.floats(-2.5, 2.5), force=st.sampled_from(hill.FORCES))
def test_energy_on_the_hill_is_what_the_engine_gives(x: float, v: float, force: float) -> None:
    def energy(motion: hill.Motion) -> float:
        at = motion.position
        slope = (hill.height(at + 1e-6) - hill.height(at - 1e-6)) / 2e-6
        return 0.5 * motion.velocity**2 * (1.0 + slope**2) + hill.GRAVITY * hill.height(at)

    before = hill.Motion(x, v)
    after = hill.advance(before, force)
    # Of the up to 20 J about; the curvature jumps at 0.
    given = force * (after.position - x)
    assert energy(after) - energy(before) == pytest.approx(given, abs=0.4)


@given(angle=st.floats(-4, 4), speed=st.floats(-10, 10), torque=st.sampled_from(swing_up.TORQUES))
def test_the_pendulum_moves_by_its_equation(angle: float, speed: float, torque: float) -> None:
    def slope(now: np.ndarray) -> np.ndarray:
        pull = swing_up.GRAVITY * math.sin(now[0]) + torque - swing_up.FRICTION * now[1]
        return np.array([now[1], pull])

    expected = fine((angle, speed), slope, swing_up.CONTROL_PERIOD)
    after = swing_up.advance(swing_up.Motion(angle, speed), torque)
    if abs(after.speed) < swing_up.TOP_SPEED:
        assert after == pytest.approx(tuple(expected), abs=0.05)


@given(
    motion=st.tuples(st.floats(-10, 10), st.floats(0, 20), st.floats(-5, 5), st.floats(-6, 6)),
    thrust=st.sampled_from(landing.THRUSTS),
)
def test_the_lander_moves_by_its_equation(
    motion: tuple[float, float, float, float], thrust: tuple[float, float]
) -> None:
    def slope(now: np.ndarray) -> np.ndarray:
        drag = landing.DRAG * math.hypot(now[2], now[3])
        up = thrust[1] - landing.GRAVITY - drag * now[3]
        return np.array([now[2], now[3], thrust[0] - drag * now[2], up])

    expected = fine(motion, slope, landing.CONTROL_PERIOD)
    after = landing.advance(landing.Motion(*motion), thrust)
    assert after == pytest.approx(tuple(expected), abs=0.03)


def test_the_car_starts_at_rest_in_the_valley_and_ends_at_the_top() -> None:
    env = Hill()
    for seed in range(50):
        env.reset(seed=seed)
        assert hill.START[0] <= env.motion.position <= hill.START[1]
        assert env.motion.velocity == 0.0
    for velocity, there in ((0.05, False), (1.0, True)):
        env.motion = hill.Motion(hill.TOP - 0.01, velocity)
        assert env.step(1)[1:] == (-1.0, there, False, {"at_top": there})


def test_the_pendulum_starts_hanging_and_is_paid_for_its_height() -> None:
    env = SwingUp()
    for seed in range(50):
        env.reset(seed=seed)
        assert abs(env.motion.angle - math.pi) <= swing_up.START_BOUND
        assert abs(env.motion.speed) <= swing_up.START_BOUND
    for angle, height in ((0.0, 1.0), (math.pi / 2, 0.5), (math.pi, 0.0)):
        env.motion = swing_up.Motion(angle, 0.0)
        observation, reward, _, _, info = env.step(1)
        seen = (math.cos(env.motion.angle), math.sin(env.motion.angle), env.motion.speed)
        assert observation == pytest.approx(seen, abs=1e-6)
        assert reward == pytest.approx(height, abs=0.01)
        assert info["upright"] == (height == 1.0)


@pytest.mark.parametrize(
    ("motion", "reward", "flag"),
    [
        ((0.0, 0.02, 0.0, -0.8), 1.0, "landed"),
        ((PAD - 0.1, 0.02, 0.4, -0.8), 1.0, "landed"),
        ((0.0, 0.02, 0.0, -SOFT - 0.05), -1.0, "crashed"),
        ((0.0, 0.02, 0.6 * SOFT, -0.8), -1.0, "crashed"),
        ((-PAD - 0.1, 0.02, 0.0, -0.8), -1.0, "crashed"),
        ((REACH[0] + 1.0, 0.02, 0.0, -0.8), -1.0, "crashed"),  # on the ground it is found
        ((-REACH[0], 5.0, -1.0, 0.0), -1.0, "lost"),
        ((0.0, REACH[1], 0.0, 1.0), -1.0, "lost"),
        ((PAD + 1.0, 10.0, 2.0, -4.0), 0.0, ""),
    ],
)
def test_how_a_landing_ends(motion: tuple[float, ...], reward: float, flag: str) -> None:
    env = Landing()
    env.reset(seed=0)
    env.motion = landing.Motion(*motion)
    flags = {name: name == flag for name in ("landed", "crashed", "lost")}
    assert env.step(0)[1:] == (reward, reward != 0.0, False, flags)


def run_up(_: float, velocity: float) -> int:
    return 2 if velocity > 0.0 else 0


def swing(height: float, side: float, speed: float) -> int:
    """Push along until the energy is right, hold at the top."""
    if height > 0.8:
        wanted = -(20.0 * side + 5.0 * speed)
        return 2 if wanted > 2.5 else 0 if wanted < -2.5 else 1
    if height + speed * speed / (2.0 * swing_up.GRAVITY) < 1.0:
        return 2 if speed > 0.0 else 0
    return 1


def land(offset: float, height: float, sideways: float, upwards: float) -> int:
    """Brake where it falls too fast for its height, else steer for the pad."""
    if upwards < -(0.4 + 0.2 * height):
        return 3
    wanted = max(-1.0, min(1.0, -0.4 * offset))
    return 2 if sideways < wanted - 0.1 else 1 if sideways > wanted + 0.1 else 0


@pytest.mark.parametrize(
    ("name", "rule", "of_many", "solved", "by_chance", "by_one", "actions"),
    [
        ("serp/Hill-v0", run_up, min, hill.SOLVED, -150.0, -199.0, 3),
        ("serp/SwingUp-v0", swing, min, swing_up.SOLVED, 0.5 * swing_up.SOLVED,
         0.25 * swing_up.SOLVED, 3),
        ("serp/Landing-v0", land, np.mean, landing.SOLVED, 0.0, 0.0, 4),
    ],
)  # fmt: skip
def test_it_is_solved_by_a_rule_and_neither_by_chance_nor_by_one_action(
    name: str,
    rule: Callable[..., int],
    of_many: Callable[[list[float]], float],
    solved: float,
    by_chance: float,
    by_one: float,
    actions: int,
) -> None:
    rng = np.random.default_rng(1)
    assert of_many(returns(name, rule, 20)) >= solved
    assert np.mean(returns(name, lambda *_: int(rng.integers(actions)), 20)) < by_chance
    for action in range(actions):
        assert max(returns(name, lambda *_, action=action: action, 5)) < by_one
