"""The rules of a contest on placed situations."""

from __future__ import annotations

import math

import numpy as np
import pytest

from serp_envs.soccer.contest import Contest
from serp_envs.soccer.fields import FIELDS, SPL_2020, Field
from serp_envs.soccer.observation import MIRROR
from serp_envs.soccer.opponents.attacker import Attacker
from serp_envs.soccer.physics.robot import NAO
from serp_envs.soccer.physics.world import Pose, World
from serp_envs.soccer.referee import Referee


def placed(
    ball: tuple[float, float], defender: Pose, attacker: Pose, field: Field = SPL_2020
) -> Contest:
    """A contest in that situation; nobody moves unless commanded."""
    contest = Contest(field)
    contest.start(np.random.default_rng(0))
    contest.world = World(field, NAO, ball, (defender, attacker))
    contest.attacker = Attacker(contest.world, contest.world.robots[1])
    contest.referee = Referee(contest.world)
    contest._started = 0
    return contest


def wait(contest: Contest, looks: int) -> list[str | None]:
    seen = []
    for _ in range(looks):
        contest.world.advance()
        ruling = contest.judge()
        seen.append(ruling.outcome if ruling else None)
    return seen


def test_a_ball_held_for_a_second_away_from_the_attacker_is_secured() -> None:
    contest = placed((-2.0, 0.0), (-2.25, 0.0, 0.0), (-1.4, 0.0, math.pi))
    assert wait(contest, 10) == [None] * 9 + ["secured"]


@pytest.mark.parametrize("attacker_x", [-1.52, -1.6])
def test_a_ball_near_the_attacker_is_not_secured(attacker_x: float) -> None:
    contest = placed((-2.0, 0.0), (-2.25, 0.0, 0.0), (attacker_x, 0.0, math.pi))
    assert wait(contest, 10) == [None] * 10


@pytest.mark.parametrize(
    ("defender_x", "attacker_x", "outcome"),
    [(-2.25, -1.27, "exit-nearer"), (-2.73, -1.7, "exit-farther"), (-2.71, -1.29, None)],
)
def test_who_is_nearer_when_one_leaves_wins_the_exit(
    defender_x: float, attacker_x: float, outcome: str | None
) -> None:
    contest = placed((-2.0, 0.0), (defender_x, 0.0, 0.0), (attacker_x, 0.0, 0.0))
    assert wait(contest, 1) == [outcome]


@pytest.mark.parametrize("name", FIELDS)
def test_between_the_posts_is_a_goal_and_beside_them_is_out(name: str) -> None:
    field = FIELDS[name]

    def crossing(y: float) -> str | None:
        contest = placed((-4.4, y), (-2.0, 2.5, 0.0), (-2.0, -2.5, 0.0), field)
        contest.world.kick(math.pi, 1.5, np.random.default_rng(0))
        seen = wait(contest, 5)
        return next((outcome for outcome in seen if outcome), None)

    inside = field.half_goal - field.ball_radius - 0.01
    outside = field.half_goal + 2 * field.post_radius + field.ball_radius + 0.01
    assert [crossing(inside), crossing(-inside)] == ["goal", "goal"]
    assert [crossing(outside), crossing(-outside)] == ["out", "out"]


def test_the_reward_of_a_decision() -> None:
    # 0.5 nearer than the attacker; half the goal is atan(0.75/2.5), half the robot asin(0.2/1).
    contest = placed((-2.0, 0.0), (-3.0, 0.0, 0.0), (-0.5, 0.0, 0.0))
    coverage = math.asin(0.2) / math.atan2(0.75, 2.5)
    expected = 0.05 * 0.5 / 0.7 + 0.10 * (coverage - 1.0)
    assert contest.reward() == pytest.approx(expected)


def test_the_observation_of_a_hand_computed_situation() -> None:
    contest = placed((-1.5, 0.0), (-2.0, 0.25, 0.0), (-1.0, 0.0, math.pi))
    expected = [1.0, -0.5, -1.0, 0.0, 0, 0, -1, 0, 1, 0, 1.0, 0.0, 0, 0, 0, 0]
    assert contest.observe() == pytest.approx(expected, abs=1e-6)


def test_the_mirrored_world_gives_the_mirrored_observation() -> None:
    contest = placed((-1.5, 0.7), (-2.0, 0.25, 0.3), (-1.0, 0.9, 2.5))
    mirror = placed((-1.5, -0.7), (-2.0, -0.25, -0.3), (-1.0, -0.9, -2.5))
    assert mirror.observe() == pytest.approx(contest.observe() * MIRROR, abs=1e-6)
    assert mirror.reward() == pytest.approx(contest.reward())
