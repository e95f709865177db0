"""The rules of a contest on placed situations."""

import math

import numpy as np
import pytest

from serp_envs import CornerKickDefender
from serp_envs.soccer import actions
from serp_envs.soccer.contest import Contest
from serp_envs.soccer.corner_kick import CornerKick
from serp_envs.soccer.fields import FIELDS, SPL_2020, Field
from serp_envs.soccer.opponents.attacker import Attacker
from serp_envs.soccer.physics.robot import NAO
from serp_envs.soccer.physics.world import Pose, World
from serp_envs.soccer.referee import Referee

# The signs that an observation takes in the mirror image of the world, left for right.
MIRROR = (1, -1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1, 1, 1, 1, 1)


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


def test_the_ball_lies_at_a_corner_of_the_own_side_until_it_is_kicked() -> None:
    env = CornerKickDefender()
    sides = set()
    for seed in range(20):
        _, info = env.reset(seed=seed)
        assert info["ball_x"] == pytest.approx(-4.45)
        assert info["ball_y"] == pytest.approx(2.95 * info["corner"])
        waited = 0
        while not info["kicked"]:
            assert math.hypot(info["ball_vx"], info["ball_vy"]) == 0.0
            _, _, terminated, truncated, info = env.step(2)
            assert not (terminated or truncated)
            waited += 1
        assert 2 <= waited <= 8  # 1 to 3 s
        assert info["ball_vy"] * info["corner"] < 0.0
        sides.add(info["corner"])
    assert sides == {1.0, -1.0}


def placed_corner(
    ball: tuple[float, float], defender: tuple[float, float], attacker: tuple[float, float]
) -> CornerKick:
    """A corner that was taken, in that situation; the ball is between defender and far away."""
    corner = CornerKick(SPL_2020)
    corner.start(np.random.default_rng(0))
    poses = [(*place, 0.0) for place in (defender, attacker, (4.0, 2.0))]
    corner.world = corner.attack.world = World(SPL_2020, NAO, ball, poses)
    corner.attack.kicked = True
    corner.referee = Referee(corner.world)
    return corner


def test_a_clearance_that_rolls_away_is_cleared_and_another_ball_is_not() -> None:
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


def test_corners_of_both_sides_look_alike() -> None:
    one = placed_corner((-3.5, 1.0), (-4.0, 0.4), (-3.0, 1.3))
    other = placed_corner((-3.5, -1.0), (-4.0, -0.4), (-3.0, -1.3))
    one.attack.side, other.attack.side = 1.0, -1.0
    assert one.observe() == pytest.approx(other.observe(), abs=1e-6)
    assert one.reward() == pytest.approx(other.reward())


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
