"""Learns what is known to be right: the optimal Q of a small deterministic task."""

import numpy as np
import pytest

from serp.learning.dqn import DQN
from serp.settings import LearnerSettings

STATES, ACTIONS, DISCOUNT = 5, 2, 0.8


def step(state, action):
    """A corridor: 0 steps left, 1 right. The right end gives 1, the left end -1; both end it."""
    after = state + (1 if action else -1)
    if after == STATES:
        return state, 1.0, True
    if after < 0:
        return state, -1.0, True
    return after, -0.05, False


def optimal_q():
    q = np.zeros((STATES, ACTIONS))
    for _ in range(200):
        for state in range(STATES):
            for action in range(ACTIONS):
                after, reward, terminated = step(state, action)
                q[state, action] = reward + (0 if terminated else DISCOUNT * q[after].max())
    return q


INPUTS = np.eye(STATES, dtype=np.float32)


def experience(agent, episodes, rng):
    """Any first action, then the best ones: so n-step returns are those of the optimal policy."""
    best = optimal_q().argmax(axis=1)
    for _ in range(episodes):
        state, action = int(rng.integers(STATES)), int(rng.integers(ACTIONS))
        terminated = False
        while not terminated:
            after, reward, terminated = step(state, action)
            agent.remember(INPUTS[state], action, reward, INPUTS[after], terminated, False)
            state, action = after, int(best[after])


RECIPES = {
    "paper": {"target_polyak": None, "n_step": 1},
    "LayerNorm": {"target_polyak": 0.05, "layer_norm": True},
    "members": {"target_polyak": 0.05, "members": 3},
    "small memory": {"target_polyak": 0.05, "buffer_size": 60},
}


@pytest.mark.parametrize("recipe", RECIPES)
def test_learns_the_optimal_q(recipe):
    given = {"hidden": (32, 32), "learning_rate": 0.003}
    agent = DQN(STATES, ACTIONS, LearnerSettings(**given, **RECIPES[recipe]), 1, discount=DISCOUNT)
    experience(agent, 300, np.random.default_rng(0))
    agent.pretrain(1500)
    np.testing.assert_allclose(agent.learning.online.q(INPUTS), optimal_q(), atol=0.08)
    greedy = [agent.propose_greedily(x).action for x in INPUTS]
    assert greedy == optimal_q().argmax(axis=1).tolist()
