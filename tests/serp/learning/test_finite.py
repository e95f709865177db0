"""Whatever stops being finite is named, and nothing is learned or saved from then on."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.errors import LearningFailure
from serp.learning import DQN
from serp.settings import LearnerSettings

F, A = 4, 3


def learner(seed: int, **changes: Any) -> DQN:
    small: dict[str, Any] = {
        "hidden": (8, 8), "batch_size": 8, "buffer_size": 64, "learning_starts": 1,
        "target_period": 7, "symmetry": False, "epsilon_steps": 30,
    }  # fmt: skip
    return DQN(F, A, LearnerSettings(**{**small, **changes}), seed)


def trained(seed: int, **changes: Any) -> tuple[DQN, np.random.Generator]:
    """A learner with 20 random env steps behind it."""
    agent, rng = learner(seed, **changes), np.random.default_rng(seed)
    for _ in range(20):
        x, following = rng.standard_normal((2, F)).astype(np.float32)
        reward, (terminated, truncated) = float(rng.standard_normal()), rng.random(2) < 0.1
        agent.remember(
            x, agent.propose(x).action, reward, following, bool(terminated), bool(truncated)
        )
        agent.learn()
    return agent, rng


@settings(max_examples=30, deadline=None)
@given(st.data(), st.booleans(), st.sampled_from(["mse", "huber"]))
def test_a_hidden_parameter_that_is_no_number_is_named_before_anything_is_learned(
    data: st.DataObject, layer_norm: bool, loss: str
) -> None:
    """Wherever it lies: no ReLU, no normalisation and no bound of a target hides it."""
    agent, _ = trained(1, layer_norm=layer_norm, loss=loss, members=2)
    online = agent.networks.online
    member = data.draw(st.integers(0, 1))
    column = data.draw(st.integers(0, online.layers[-1].start - 1))
    agent.networks.arrays()["parameters"][member, column] = np.nan
    before = {name: array.copy() for name, array in agent.networks.arrays().items()}
    place = f"the {online.place_of(column)} in network {member + 1} of 2: nan"
    with pytest.raises(LearningFailure, match=place):
        agent.pretrain(3)
    for name, array in agent.networks.arrays().items():
        np.testing.assert_array_equal(array, before[name])


@given(st.data(), st.sampled_from([np.nan, np.inf, -np.inf]))
def test_nothing_that_is_not_finite_is_saved(data: st.DataObject, value: float) -> None:
    agent = learner(1, members=2)
    name = data.draw(st.sampled_from(sorted(agent.networks.arrays())))
    array = agent.networks.arrays()[name]
    member, column = (data.draw(st.integers(0, count - 1)) for count in array.shape)
    array[member, column] = value
    place = f"{agent.networks.online.place_of(column)} in network {member + 1} of 2: {value}"
    with pytest.raises(LearningFailure, match=f"saved is not finite.*{place}"):
        agent.state_dict()


def test_places_of_parameters_are_told_apart() -> None:
    network = learner(0, layer_norm=True).networks.online
    words = [network.place_of(column) for column in range(network.parameters.shape[1])]
    shown = list(dict.fromkeys(words))
    assert shown == [
        *(f"{part} of layer {n}" for n in (1, 2) for part in ("weights", "bias", "gain", "shift")),
        "weights of layer 3", "bias of layer 3",
    ]  # fmt: skip
    assert words.count("weights of layer 1") == 4 * 8


def test_numbers_that_grow_too_large_in_the_network_are_named() -> None:
    agent, rng = trained(2, layer_norm=False, loss="mse", discount=0.0)
    x, following = rng.standard_normal((2, 4))
    following[2] = 3e38
    for _ in range(70):
        agent.remember(x, 0, 1e20, following, False, False)
    with pytest.raises(LearningFailure, match=r"the largest .* is next input 2: 3e\+38"):
        agent.pretrain(10)


def test_a_reward_whose_return_float32_cannot_hold_is_refused() -> None:
    agent, _ = trained(3, discount=0.99, reward_scale=10.0)
    before = agent.state_dict()
    for reward in (1e36, -1e300, np.inf, np.nan):
        with pytest.raises(LearningFailure, match=re.escape(f"rewards such as {reward:g}")):
            agent.remember(np.zeros(4), 0, reward, np.zeros(4), True, False)
    after = agent.state_dict()
    assert before[1] == after[1]
    for name, array in before[0].items():
        np.testing.assert_array_equal(array, after[0][name])
