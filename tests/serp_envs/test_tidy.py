"""The tidying robot: its physics, its macro-actions, and what makes them fail."""

import gymnasium
import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled
from gymnasium.utils.env_checker import check_env

pytest.importorskip("mujoco")

from serp_envs.tidy import MACROS, OBSERVED, PLACES, TABLE, THINGS, TidyRoom

NAMES = list(MACROS)
ROUTE = ("drive table", "approach glass", "grasp glass", "drive shelf", "place-on-shelf")


def begun(seed=0, **options):
    """An environment at the start of an episode, without anybody in the way."""
    env = TidyRoom(**options)
    env.reset(seed=seed)
    stand(env, 0.6, -1.1)
    env.battery = 0.9
    return env


def stand(env, x, y):
    """Let the person stand somewhere for good."""
    env._rest, env.person = 1e9, (x, y)
    env.data.mocap_pos[0, :2] = env.person


def act(env, *actions):
    """Do actions; return the last step, its observation by name."""
    for action in actions:
        step = env.step(NAMES.index(action))
    return (dict(zip(OBSERVED, step[0].tolist(), strict=True)), *step[1:])


def put(env, place):
    """Put the base at a place."""
    env.data.qpos[env._base : env._base + 3] = PLACES[place]


def grasped(env, name, tries=6):
    """Grasp a thing, as often as it takes."""
    put(env, "table")
    for _ in range(tries):
        if act(env, f"approach {name}", f"grasp {name}")[0][f"held {name}"]:
            return True
    return False


def test_gymnasiums_checker_has_nothing_to_say():
    check_env(gymnasium.make("serp_envs:serp/TidyRoom-v0").unwrapped, skip_render_check=True)


def test_equal_seeds_give_equal_episodes_also_on_a_used_object_and_others_differ():
    def episode(env, seed):
        first, _ = env.reset(seed=seed)
        steps = [env.step(NAMES.index(action)) for action in ROUTE]
        return [first.tobytes()] + [(step[0].tobytes(), *step[1:]) for step in steps]

    used = TidyRoom()
    first = episode(used, 3)
    assert episode(used, 4) != first
    assert episode(used, 3) == first == episode(TidyRoom(), 3)


def test_every_observation_is_in_the_space_and_inapplicable_actions_change_little():
    env = TidyRoom()
    random = np.random.default_rng(1)
    env.reset(seed=1)
    for action in random.integers(0, len(NAMES), 40):
        observation, _, terminated, _, info = env.step(action)
        assert env.observation_space.contains(observation)
        assert terminated == (info["unsafe"] or env.done)
        if terminated:
            env.reset()
    env.reset(seed=2)
    for name in ("place-on-shelf", "open-drawer", "charge", "grasp can"):
        before = env.seconds
        seen, reward, *_ = act(env, name)
        assert env.seconds - before == pytest.approx(0.5) and reward == pytest.approx(-0.005)
    assert seen["z can"] > TABLE and not seen["held can"]


def test_each_macro_action_reaches_its_purpose():
    """From a fair state; a grasp may be tried again."""
    env = begun()
    for place, pose in PLACES.items():
        for way in ("drive", "rush"):
            put(env, "charger" if place == "table" else "table")
            stand(env, *((-0.3, -1.0) if place in ("drawer", "shelf") else (0.6, 0.9)))
            seen = act(env, f"{way} {place}")[0]
            assert env.at(place)
            assert np.hypot(seen["x"] - pose.x, seen["y"] - pose.y) < 0.06
    stand(env, 0.6, -1.1)
    put(env, "drawer")
    for _ in range(3):
        seen = act(env, "open-drawer")[0]
    assert seen["opening"] > 0.3
    for name, place, thing in (("can", "in-drawer", "drawer"), ("glass", "on-shelf", "shelf")):
        assert grasped(env, name)
        assert act(env, "put-back")[0][f"z {name}"] == pytest.approx(
            TABLE + THINGS[name].half, abs=0.01
        )
        assert grasped(env, name)
        seen, reward, *_ = act(env, f"drive {thing}", f"place-{place}")
        assert seen[f"tidy {name}"] and not seen[f"held {name}"] and reward > 0.8
    put(env, "drawer")
    assert act(env, "close-drawer")[0]["opening"] < 0.03
    before = env.seconds
    act(env, "wait")
    assert env.seconds - before == pytest.approx(1.0)
    put(env, "charger")
    env.battery = 0.5
    assert act(env, "charge")[0]["battery"] > 0.95


def test_a_glass_that_is_rushed_spills_and_one_that_is_driven_does_not():
    for way, spilled in (("rush", True), ("drive", False)):
        env = begun(seed=5)
        assert grasped(env, "glass")
        _, reward, terminated, _, info = act(env, f"{way} shelf")
        assert (info["spilled"], terminated) == (spilled, spilled)
        assert (reward < -4.0) == spilled


def test_a_rush_runs_into_the_person_and_a_drive_stops():
    for way, hit in (("rush", True), ("drive", False)):
        env = begun()
        put(env, "table")
        stand(env, 0.0, -0.2)
        seen, _, terminated, _, info = act(env, f"{way} drawer")
        assert info["hit"] == info["unsafe"] == terminated == hit
        assert not env.at("drawer") and seen["x"] < -0.4


def test_a_worn_gripper_slips_more_often():
    def slips(wear):
        lost = 0
        for seed in range(3):
            env = begun(seed, wear=wear)
            put(env, "table")
            act(env, "approach bottle")
            for _ in range(3):
                lost += not act(env, "grasp bottle")[0]["held bottle"]
                env.held = ""
        return lost

    new, half, smooth = slips(0.0), slips(0.4), slips(0.8)
    assert new < half < smooth == 9


def test_an_empty_battery_ends_the_episode():
    env = begun()
    env.battery = 0.005
    seen, reward, terminated, _, info = act(env, "drive shelf")
    assert seen["battery"] == 0.0 and terminated and info["empty"] and reward < -4.0


def test_a_picture_changes_no_episode():
    env, plain = TidyRoom(render_mode="rgb_array"), TidyRoom()
    env.reset(seed=3), plain.reset(seed=3)
    try:
        assert env.render().shape == (360, 480, 3)
    except DependencyNotInstalled as error:
        assert "apt install libegl1" in str(error)
    step = NAMES.index("drive table")
    assert env.step(step)[0].tobytes() == plain.step(step)[0].tobytes()
    env.close()
    with pytest.raises(ValueError, match="render_mode"):
        TidyRoom(render_mode="drawing")
