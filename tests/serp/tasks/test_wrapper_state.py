"""What wrappers and environments carry from one episode to the next is saved."""

import json
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers

from serp.tasks.wrapper_state import restore, save
from tests.serp.sample_tasks import Corridor

Env = gym.Env[Any, Any]


class Found(gym.Env[Any, Any]):
    """A noisy number. Its noise is its own: no reset seeds it."""

    observation_space = gym.spaces.Box(-np.inf, np.inf, (2,), np.float64)
    action_space = gym.spaces.Discrete(2)

    def __init__(self, generator=lambda: np.random.PCG64(4)):
        self.noise = np.random.Generator(generator())
        self.steps = 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.steps = 0
        return self.np_random.normal(size=2), {}

    def step(self, action):
        self.steps += 1
        seen = self.noise.normal(size=2) + self.np_random.normal(size=2)
        return seen, float(seen[0]), self.steps >= 5, False, {}


STACKS = [
    Found,
    lambda: Found(lambda: np.random.MT19937(1)),
    lambda: wrappers.NormalizeObservation(Found()),
    lambda: wrappers.NormalizeReward(Found(), gamma=0.9),
    lambda: wrappers.MaxAndSkipObservation(Found(), skip=2),
    lambda: wrappers.TimeLimit(
        wrappers.NormalizeReward(wrappers.NormalizeObservation(Corridor())), 7
    ),
    lambda: wrappers.NormalizeObservation(wrappers.NormalizeObservation(Found())),
]


def episodes(env, numbers):
    said = []
    for number in numbers:
        said.append(env.reset(seed=number)[0].tolist())
        ended = False
        while not ended:
            seen, reward, terminated, truncated, _ = env.step(len(said) % 2)
            ended = terminated or truncated
            said.append((seen.tolist(), float(reward)))
    return said


@pytest.mark.parametrize("make", STACKS)
def test_a_new_environment_goes_on_exactly_where_the_saved_one_was(make):
    whole = make()
    episodes(whole, range(3))
    saved = json.loads(json.dumps(save(whole)))
    expected = episodes(whole, range(3, 6))
    assert episodes(make(), range(3, 6)) != expected  # there is something to carry
    other = make()
    restore(other, saved)
    assert episodes(other, range(3, 6)) == expected


class Wider(Found):
    observation_space = gym.spaces.Box(-np.inf, np.inf, (3,), np.float64)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (Found, "only the saved environment has a wrapper with `obs_rms`"),
        (
            lambda: wrappers.NormalizeObservation(Corridor()),
            "0 wrappers with a state_dict.*one has 1",
        ),
        (
            lambda: wrappers.NormalizeObservation(Wider()),
            r"shape \(3,\), but the saved array has \(2,\)",
        ),
    ],
)
def test_other_layers_than_the_saved_ones_are_refused(make, said):
    saved = save(wrappers.NormalizeObservation(Found()))
    with pytest.raises(ValueError, match=said):
        restore(make(), saved)
