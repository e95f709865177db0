from __future__ import annotations

import numpy as np
import pytest

from serp.learning import DQNSettings
from serp.learning.network import QNetwork, Workspace
from serp.learning.networks import Networks

F, A = 4, 3


def networks(**changes: object) -> Networks:
    settings = DQNSettings(hidden=(8, 5), members=2, **changes)  # type: ignore[arg-type]
    return Networks(F, A, settings, np.random.default_rng(0), start_at_zero=False)


def learn(one: Networks, steps: int) -> None:
    """Moves every Q-value towards 0, in states that depend on the count of updates."""
    work = Workspace(one.online, 6)
    for _ in range(steps):
        x = np.random.default_rng(one.updates).standard_normal((6, F)).astype(np.float32)
        one.online.forward(x, work)
        work.q_gradient[...] = work.q
        one.online.backward(work)
        one.step()


@pytest.mark.parametrize(
    "target", [{"target_period": None}, {}, {"target_period": None, "target_polyak": 0.1}]
)
def test_networks_that_move_go_on_as_they_would_have(target: dict[str, object]) -> None:
    stays, moves = networks(layer_norm=True, **target), networks(layer_norm=True, **target)
    wide = stays.online.another(5)
    wide_target = wide if stays.target is stays.online else stays.online.another(5)
    learn(stays, 10)
    learn(moves, 10)
    moves.move_into(wide.part(2, 4), wide_target.part(2, 4))
    learn(stays, 10)
    learn(moves, 10)
    assert stays.arrays().keys() == moves.arrays().keys()
    for name, array in stays.arrays().items():
        np.testing.assert_array_equal(array, moves.arrays()[name], err_msg=name)
    np.testing.assert_array_equal(wide.parameters[2:4].numpy(), stays.online.parameters.numpy())
    assert not wide.parameters[:2].any() and not wide.parameters[4:].any()


def test_a_network_that_starts_at_zero_learns_all_the_same() -> None:
    settings = DQNSettings(hidden=(8,))
    one = Networks(F, A, settings, np.random.default_rng(0), start_at_zero=True)
    work = Workspace(one.online, 3)
    x = np.random.default_rng(1).standard_normal((3, F)).astype(np.float32)
    assert not one.online.forward(x, work).any()
    assert not one.target.forward(x, work).any()
    for _ in range(1500):
        one.online.forward(x, work)
        work.q_gradient[...] = work.q - 1.0
        one.online.backward(work)
        one.step()
    np.testing.assert_allclose(one.online.forward(x, work), 1.0, atol=0.05)


def test_a_part_shares_memory_and_answers_as_the_whole() -> None:
    whole = QNetwork(F, A, (8,), members=4, rng=np.random.default_rng(0))
    part = whole.part(1, 3)
    x = np.ones((2, F), np.float32)
    np.testing.assert_array_equal(
        part.forward(x, Workspace(part, 2)), whole.forward(x, Workspace(whole, 2))[1:3]
    )
    whole.parameters[1] = 0.0
    assert not part.forward(x, Workspace(part, 2))[0].any()
