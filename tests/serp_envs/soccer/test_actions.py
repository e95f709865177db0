"""The charge: when it hits, what a hit does, how it kicks a ball that is in the way."""

from __future__ import annotations

import math

import numpy as np
import pytest

from serp_envs.soccer import actions
from serp_envs.soccer.fields import FIELDS, SPL_2020, Field
from serp_envs.soccer.physics.robot import NAO
from serp_envs.soccer.physics.world import World

FAR_AWAY = (3.0, 2.0)


def facing(
    distance: float, off: float, ball: tuple[float, float] = FAR_AWAY, field: Field = SPL_2020
) -> World:
    """A robot at (0, 0) that looks along x, an opponent so far from it, so far off its heading."""
    place = (distance * math.cos(off), distance * math.sin(off), 0.0)
    return World(field, NAO, ball, ((0.0, 0.0, 0.0), place))


def charge(world: World, seed: int = 0) -> bool:
    robot, opponent = world.robots
    return actions.charge(world, robot, opponent, np.random.default_rng(seed))


@pytest.mark.parametrize("field", FIELDS.values(), ids=FIELDS)
@pytest.mark.parametrize(
    ("distance", "off", "hits"),
    [
        (0.399, 0.0, True),
        (0.401, 0.0, False),
        (0.35, 0.599, True),
        (0.35, -0.599, True),
        (0.35, 0.601, False),
        (0.35, -0.601, False),
        (0.35, math.pi, False),
    ],
)
def test_a_charge_hits_within_40_cm_and_within_0_6_rad_of_its_heading(
    field: Field, distance: float, off: float, hits: bool
) -> None:
    world = facing(distance, off, field=field)
    robot, opponent = world.robots
    assert charge(world) == hits
    assert (robot.hit_ready > 0) == hits
    if not hits:
        assert (robot.down_until, opponent.down_until) == (0, 0)


def test_seven_hits_in_ten_fell_the_opponent_and_two_the_charger_for_four_seconds() -> None:
    hits = 4000
    rng = np.random.default_rng(7)
    world = facing(0.35, 0.0)
    robot, opponent = world.robots
    falls = np.zeros((hits, 2), dtype=bool)
    for hit in range(hits):
        robot.hit_ready = robot.down_until = opponent.down_until = 0
        assert actions.charge(world, robot, opponent, rng)
        for column, one in enumerate((opponent, robot)):
            assert one.down_until in (0, world.tick + 40)
            falls[hit, column] = one.down_until > 0
    for share, probability in zip(falls.mean(axis=0), (0.7, 0.2), strict=True):
        error = math.sqrt(probability * (1.0 - probability) / hits)
        assert abs(share - probability) < 4.0 * error
    # The one falls whether or not the other does.
    both = falls.all(axis=1).mean()
    assert abs(both - 0.14) < 4.0 * math.sqrt(0.14 * 0.86 / hits)
