"""Small learners, and random lives for them."""

import numpy as np

from serp.learning.dqn import DQN
from serp.settings import LearnerSettings

F, A = 4, 3


def learner(seed=0, imitates=False, discount=0.99, **settings):
    small = {"hidden": (8, 8), "batch_size": 8, "buffer_size": 64, "learning_starts": 1}
    made = DQN(F, A, LearnerSettings(**{**small, **settings}), seed, imitates, discount)
    made.imitation_weight = 0.7
    return made


def live(agent, rng, steps):
    """Take random env steps with random advice; return what the learner said."""
    said = []
    for _ in range(steps):
        x, next_x = rng.standard_normal((2, F)).astype(np.float32)
        proposal = agent.propose(x, rng.random(A) < 0.5)
        said.append((proposal.action, proposal.exploratory, agent.epsilon))
        said.append(agent.learning.online.q(x).tolist())
        action = int(rng.integers(A))
        imitated = int(rng.integers(-1, A)) if agent.imitates else -1
        end = rng.random(2) < 0.1
        reward = float(rng.standard_normal())
        agent.remember(x, action, reward, next_x, bool(end[0]), bool(end[1]), imitated)
        said.append(agent.learn())
    return said


def assert_same_state(one, other):
    arrays, meta = one.state_dict()
    other_arrays, other_meta = other.state_dict()
    assert meta == other_meta
    assert arrays.keys() == other_arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(array, other_arrays[name], err_msg=name, strict=True)


def set_q(agent, q, target=None):
    """Make Q the same in every state; in the target network another."""
    for name, array in agent.learning.arrays().items():
        if name in ("parameters", "target"):
            array[:] = 0.0
            array[:, -A:] = target if target and name == "target" else q  # the last layer's bias
