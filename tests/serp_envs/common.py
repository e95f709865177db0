"""The environments of `serp_envs`, and ways to play them."""

from functools import partial
from typing import Any

import gymnasium
import numpy as np

from serp_envs import CartPole, CornerKickDefender, Hill, Landing, SoccerDefender, SwingUp

Env = gymnasium.Env[Any, Any]
SMALL = {"field": "hsl-small-2026"}
KINDS = {
    "cartpole": ("serp/CartPole-v0", CartPole),
    "hill": ("serp/Hill-v0", Hill),
    "landing": ("serp/Landing-v0", Landing),
    "swing-up": ("serp/SwingUp-v0", SwingUp),
    "soccer": ("serp/SoccerDefender-v0", SoccerDefender),
    "soccer, small field": ("serp/SoccerDefender-v0", partial(SoccerDefender, **SMALL)),
    "corner-kick": ("serp/CornerKick-v0", CornerKickDefender),
    "corner-kick, small field": ("serp/CornerKick-v0", partial(CornerKickDefender, **SMALL)),
}


def actions_of(kind, seed, count):
    """Actions drawn at random."""
    return np.random.default_rng(seed).integers(0, KINDS[kind][1]().action_space.n, count)


def bits(step):
    """What a step or a reset returns, with the observation as its bits."""
    return (step[0].tobytes(), *step[1:])


def play(env, seed, actions, **options):
    """All that is shown until the actions end, over as many episodes as that takes."""
    return [bits(env.reset(seed=seed, options=options or None)), *go_on(env, actions)]


def go_on(env, actions):
    """The same of a running episode and those after it."""
    seen = []
    for action in actions:
        seen.append(bits(env.step(int(action))))
        if seen[-1][2] or seen[-1][3]:
            seen.append(bits(env.reset()))
    return seen


def returns(name, act, episodes):
    """Returns of episodes with seeds 0, 1, …; `act` gets the numbers of the observation."""
    env = gymnasium.make(f"serp_envs:{name}")
    found = []
    for seed in range(episodes):
        observation, _ = env.reset(seed=seed)
        total, ended = 0.0, False
        while not ended:
            observation, reward, terminated, truncated, _ = env.step(act(*observation.tolist()))
            total += float(reward)
            ended = terminated or truncated
        found.append(total)
    return found
