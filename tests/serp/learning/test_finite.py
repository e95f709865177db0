"""Whatever stops being finite is named, and nothing is learned or saved from then on."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.errors import LearningFailure
from tests.serp.learning.learners import assert_same_state, learner, live


def trained(seed, **changes):
    """Return a learner with 20 random env steps behind it."""
    agent = learner(seed, **changes)
    live(agent, np.random.default_rng(seed), 20)
    return agent


@settings(max_examples=30, deadline=None)
@given(st.data(), st.booleans())
def test_a_hidden_parameter_that_is_no_number_is_named_before_anything_is_learned(data, layer_norm):
    """Wherever it lies: no ReLU, no normalisation and no bound of a target hides it."""
    agent = trained(1, layer_norm=layer_norm, members=2)
    online = agent.learning.online
    member = data.draw(st.integers(0, 1))
    column = data.draw(st.integers(0, online.layers[-1].start - 1))
    agent.learning.arrays()["parameters"][member, column] = np.nan
    before = {name: array.copy() for name, array in agent.learning.arrays().items()}
    layer = next(i for i, layer in enumerate(online.layers, 1) if column < layer.end)
    place = f"in the parameters of layer {layer}"
    with pytest.raises(LearningFailure, match=place):
        agent.pretrain(3)
    for name, array in agent.learning.arrays().items():
        np.testing.assert_array_equal(array, before[name])


@given(st.data(), st.sampled_from([np.nan, np.inf, -np.inf]))
def test_nothing_that_is_not_finite_is_saved(data, value):
    agent = learner(1, members=2)
    name = data.draw(st.sampled_from(sorted(agent.learning.arrays())))
    array = agent.learning.arrays()[name]
    member, column = (data.draw(st.integers(0, count - 1)) for count in array.shape)
    array[member, column] = value
    with pytest.raises(LearningFailure, match=f"saved is not finite.*{name} of layer"):
        agent.state_dict()


def test_numbers_that_grow_too_large_in_the_network_are_named():
    agent = trained(2, discount=0.0)
    x, following = np.random.default_rng(0).standard_normal((2, 4))
    following[2] = 3e38
    for _ in range(70):
        agent.remember(x, 0, 1e20, following, False, False)
    with pytest.raises(LearningFailure, match=r"inputs is a next_observation: 3e\+38"):
        agent.pretrain(10)


def test_a_reward_whose_return_float32_cannot_hold_is_refused():
    agent = trained(3, discount=0.99)
    same = trained(3, discount=0.99)
    for reward in (1e37, -1e300, np.inf, np.nan):
        with pytest.raises(LearningFailure, match=re.escape(f"rewards such as {reward:g}")):
            agent.remember(np.zeros(4), 0, reward, np.zeros(4), True, False)
    assert_same_state(agent, same)
