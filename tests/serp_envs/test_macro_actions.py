"""Macro-actions: an option does what its controller would do step by step."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import InvalidAction, ResetNeeded

from serp_envs import MacroActions, SubTask, option


def along(seen):
    """Push in the direction of the motion: the last number of both observations is the speed."""
    return np.array([1.0 if seen[-1] >= 0 else -1.0], dtype=np.float32)


def against(seen):
    return -along(seen)


def there_and_back(seen):
    """Two phases, the second until the speed is that of the beginning."""
    begin = seen[-1]
    for _ in range(3):
        seen = yield along(seen)
    while abs(seen[-1] - begin) > 0.02:
        seen = yield against(seen)


OPTIONS = {
    "along": option(along, steps=7),
    "against": option(against, steps=5, until=lambda seen: abs(seen[-1]) < 0.01),
    "there-and-back": there_and_back,
}


@pytest.mark.parametrize("name", ["Pendulum-v1", "MountainCarContinuous-v0"])
def test_an_option_is_its_controls_one_after_the_other(name):
    """The same controls give the same episode: to the goal, and to the time limit."""
    controls = []

    class Recorded(gymnasium.Wrapper[Any, Any, Any, Any]):
        def step(self, action):
            controls.append(action)
            return self.env.step(action)

    env = MacroActions(Recorded(gymnasium.make(name, max_episode_steps=150)), OPTIONS)
    plain = gymnasium.make(name, max_episode_steps=150)
    random = np.random.default_rng(0)
    ends = set()
    for seed in range(6):
        seen, _ = env.reset(seed=seed)
        assert seen.tobytes() == plain.reset(seed=seed)[0].tobytes()
        over = False
        while not over:
            controls.clear()
            # The car reaches the goal where it is always pushed along.
            action = random.integers(3) if seed % 2 else 0
            seen, total, terminated, truncated, info = env.step(action)
            assert info.pop("steps") == len(controls) > 0
            by_hand = [plain.step(control) for control in controls]
            assert seen.tobytes() == by_hand[-1][0].tobytes()
            assert total == pytest.approx(sum(float(step[1]) for step in by_hand))
            assert (terminated, truncated, info) == by_hand[-1][2:]
            assert not any(step[2] or step[3] for step in by_hand[:-1])
            if action == 1:
                assert all(abs(step[0][-1]) >= 0.01 for step in by_hand[:-1])
            over = terminated or truncated
        ends.add((terminated, truncated))
    assert (False, True) in ends
    assert (True, False) in ends or name == "Pendulum-v1"


def test_what_is_wrong_is_named():
    def nothing(seen):
        yield from ()

    env = MacroActions(gymnasium.make("Pendulum-v1"), {"rest": nothing})
    with pytest.raises(ResetNeeded):
        env.step(0)
    env.reset()
    with pytest.raises(ValueError, match="option `rest` ended without a control"):
        env.step(0)
    with pytest.raises(InvalidAction, match="1 is not an action of Discrete"):
        env.step(1)
    with pytest.raises(ValueError, match="at least 1 step, not"):
        option(along, steps=0)
    with pytest.raises(TypeError, match="a controller must be a function"):
        option(np.ones(1), steps=3)
    env = MacroActions(gymnasium.make("Pendulum-v1"), {"along": along})
    env.reset()
    with pytest.raises(TypeError, match=r"yields controls, but this one returned .*; write option"):
        env.step(0)


def test_steps_bound_a_generator():
    env = MacroActions(gymnasium.make("Pendulum-v1"), {"short": option(there_and_back, steps=2)})
    env.reset(seed=0)
    assert env.step(0)[4]["steps"] == 2


def test_a_sub_task_begins_where_its_option_ends_and_ends_with_a_step_to_where_it_is_over():
    """It has that step even if it begins where it would be over."""

    def fast(seen):
        return abs(seen[-1]) > 3.0

    whole = gymnasium.make("Pendulum-v1", max_episode_steps=40)
    part = SubTask(
        gymnasium.make("Pendulum-v1", max_episode_steps=40),
        until=fast,
        begin=option(along, steps=9),
    )
    began_over = 0
    for seed in range(4):
        seen, _ = whole.reset(seed=seed)
        for _ in range(9):
            seen, *_ = whole.step(along(seen))
        begun, info = part.reset(seed=seed)
        assert info["steps"] == 9
        assert begun.tobytes() == seen.tobytes()
        began_over += fast(begun)
        ended = False
        while not ended:
            seen, reward, terminated, truncated, _ = whole.step(along(seen))
            step = part.step(along(begun))
            begun, ended = step[0], step[2] or step[3]
            assert begun.tobytes() == seen.tobytes()
            assert step[1:4] == (reward, terminated or fast(seen), truncated)
    assert 0 < began_over < 4
    never = SubTask(whole, until=fast, begin=option(along, steps=40))
    with pytest.raises(gymnasium.error.Error, match="100 episodes in a row ended in the option"):
        never.reset(seed=0)


def test_damage_on_the_way_is_not_forgotten():
    class Bumps(gymnasium.Wrapper):
        steps = 0

        def step(self, action):
            self.steps += 1
            *answer, info = super().step(action)
            return *answer, {**info, "unsafe": self.steps == 2}

    env = MacroActions(
        Bumps(gymnasium.make("Pendulum-v1")), {"on": option(lambda seen: [0.0], steps=3)}
    )
    env.reset(seed=0)
    assert [env.step(0)[-1]["unsafe"] for _ in range(2)] == [True, False]
