"""The rules of a contest on placed situations."""

import math

import numpy as np
import pytest

from serp_envs.soccer import actions
from serp_envs.soccer.contest import Contest
from serp_envs.soccer.corner_kick import CornerKick
from serp_envs.soccer.fields import FIELDS, SPL_2020
from serp_envs.soccer.opponents.attacker import Attacker
from serp_envs.soccer.physics.robot import NAO
from serp_envs.soccer.physics.world import World
from serp_envs.soccer.referee import Referee


def placed(ball, defender, attacker, field=SPL_2020):
    """A contest in that situation; nobody moves unless commanded."""
    contest = Contest(field)
    contest.start(np.random.default_rng(0))
    contest.world = World(field, NAO, ball, (defender, attacker))
    contest.attacker = Attacker(contest.world, contest.world.robots[1])
    contest.referee = Referee(contest.world)
    contest.started = 0
    return contest


def wait(contest, looks):
    seen = []
    for _ in range(looks):
        contest.world.advance()
        ruling = contest.judge()
        seen.append(ruling.outcome if ruling else None)
    return seen


def test_a_ball_held_for_a_second_away_from_the_attacker_is_secured():
    contest = placed((-2.0, 0.0), (-2.25, 0.0, 0.0), (-1.4, 0.0, math.pi))
    assert wait(contest, 10) == [None] * 9 + ["secured"]


@pytest.mark.parametrize(
    ("defender_x", "attacker_x", "outcome"),
    [(-2.25, -1.27, "exit-nearer"), (-2.73, -1.7, "exit-farther"), (-2.71, -1.29, None)],
)
def test_who_is_nearer_when_one_leaves_wins_the_exit(defender_x, attacker_x, outcome):
    contest = placed((-2.0, 0.0), (defender_x, 0.0, 0.0), (attacker_x, 0.0, 0.0))
    assert wait(contest, 1) == [outcome]


@pytest.mark.parametrize("name", FIELDS)
def test_between_the_posts_is_a_goal_and_beside_them_is_out(name):
    field = FIELDS[name]

    def crossing(y):
        contest = placed((-4.4, y), (-2.0, 2.5, 0.0), (-2.0, -2.5, 0.0), field)
        contest.world.kick(math.pi, 1.5, np.random.default_rng(0))
        seen = wait(contest, 5)
        return next((outcome for outcome in seen if outcome), None)

    inside = field.half_goal - field.ball_radius - 0.01
    outside = field.half_goal + 2 * field.post_radius + field.ball_radius + 0.01
    assert [crossing(inside), crossing(-inside)] == ["goal", "goal"]
    assert [crossing(outside), crossing(-outside)] == ["out", "out"]


def test_the_reward_of_a_decision():
    # 0.5 nearer than the attacker; half the goal is atan(0.75/2.5), half the robot asin(0.2/1).
    contest = placed((-2.0, 0.0), (-3.0, 0.0, 0.0), (-0.5, 0.0, 0.0))
    coverage = math.asin(0.2) / math.atan2(0.75, 2.5)
    expected = 0.05 * 0.5 / 0.7 + 0.10 * (coverage - 1.0)
    assert contest.reward() == pytest.approx(expected)


def placed_corner(ball, defender, attacker):
    """A corner that was taken, in that situation; the ball is between defender and far away."""
    corner = CornerKick(SPL_2020)
    corner.start(np.random.default_rng(0))
    poses = [(*place, 0.0) for place in (defender, attacker, (4.0, 2.0))]
    corner.world = corner.attack.world = World(SPL_2020, NAO, ball, poses)
    corner.attack.kicked = True
    corner.referee = Referee(corner.world)
    return corner


def test_a_clearance_that_rolls_away_is_cleared_and_another_ball_is_not():
    rng = np.random.default_rng(0)
    for kicks in (True, False):
        corner = placed_corner((-3.0, 0.0), (-3.22, 0.0), (-3.0, 2.0))
        if kicks:
            corner._clear(corner.world.robots[0], rng)
        else:
            corner.world.kick(0.0, 1.1, rng)
        ended = None
        for _ in range(40):
            corner.world.robots[0].stop()
            corner.world.advance()
            ruling = corner.judge()
            ended = ended or (ruling.outcome if ruling else None)
        assert ended == ("cleared" if kicks else None)


FAR_AWAY = (3.0, 2.0)


def facing(distance, off, ball=FAR_AWAY, field=SPL_2020):
    """A robot at (0, 0) that looks along x, an opponent so far from it, so far off its heading."""
    place = (distance * math.cos(off), distance * math.sin(off), 0.0)
    return World(field, NAO, ball, ((0.0, 0.0, 0.0), place))


def charge(world, seed=0):
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
def test_a_charge_hits_within_40_cm_and_within_0_6_rad_of_its_heading(field, distance, off, hits):
    world = facing(distance, off, field=field)
    robot, opponent = world.robots
    assert charge(world) == hits
    assert (robot.hit_ready > 0) == hits
    if not hits:
        assert (robot.down_until, opponent.down_until) == (0, 0)


def test_seven_hits_in_ten_fell_the_opponent_and_two_the_charger_for_four_seconds():
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
