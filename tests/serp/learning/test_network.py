from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from serp.learning import kernels
from serp.learning.network import MeanOfMembers, QNetwork, Workspace

SHAPES = {
    "inputs": st.integers(1, 7),
    "actions": st.integers(1, 5),
    "hidden": st.lists(st.integers(1, 24), max_size=3),
    "layer_norm": st.booleans(),
    "members": st.integers(1, 3),
    "batch": st.integers(1, 17),
    "seed": st.integers(0, 2**32),
}


def random_network(
    inputs: int, actions: int, hidden: list[int], layer_norm: bool, members: int, seed: int
) -> tuple[QNetwork, np.random.Generator]:
    rng = np.random.default_rng(seed)
    network = QNetwork(inputs, actions, hidden, layer_norm=layer_norm, members=members, rng=rng)
    noise = rng.standard_normal(tuple(network.parameters.shape), np.float32) * np.float32(0.3)
    network.parameters.add_(torch.from_numpy(noise))  # gains and shifts that matter
    return network, rng


def members_of(network: QNetwork) -> list[torch.nn.Sequential]:
    module = network.module().double()
    modules = list(module.members) if isinstance(module, MeanOfMembers) else [module]
    assert len(modules) == network.members
    return modules  # type: ignore[return-value]


def flat_gradient(module: torch.nn.Sequential) -> torch.Tensor:
    parts = []
    for layer in module:
        if isinstance(layer, torch.nn.Linear):
            parts += [layer.weight.grad.T, layer.bias.grad]
        elif isinstance(layer, torch.nn.LayerNorm):
            parts += [layer.weight.grad, layer.bias.grad]
    return torch.cat([part.reshape(-1) for part in parts])


@torch.no_grad()
def smallest_before_relu(module: torch.nn.Sequential, x: torch.Tensor) -> float:
    smallest = np.inf
    for layer in module:
        if isinstance(layer, torch.nn.ReLU):
            smallest = min(smallest, float(x.abs().min()))
        x = layer(x)
    return smallest


@torch.no_grad()
def smallest_spread(module: torch.nn.Sequential, x: torch.Tensor) -> float:
    """The smallest standard deviation that LayerNorm divides by, but for exactly equal values."""
    smallest = np.inf
    for layer in module:
        if isinstance(layer, torch.nn.LayerNorm):
            spread = x.std(-1, correction=0)
            smallest = min([smallest, *spread[spread > 0].tolist()])
        x = layer(x)
    return smallest


@settings(deadline=None, max_examples=150)
@given(**SHAPES, huber=st.booleans())
def test_gradient_equals_autograd(
    inputs: int,
    actions: int,
    hidden: list[int],
    layer_norm: bool,
    members: int,
    batch: int,
    seed: int,
    huber: bool,
) -> None:
    network, rng = random_network(inputs, actions, hidden, layer_norm, members, seed)
    x = rng.standard_normal((members, batch, inputs)).astype(np.float32)
    next_q = rng.standard_normal((members, batch, actions)).astype(np.float32) * 2
    action = rng.integers(actions, size=(members, batch))
    reward = rng.standard_normal((members, batch)).astype(np.float32)
    discount = (rng.random((members, batch)) * rng.integers(2)).astype(np.float32)
    forbidden = np.zeros((members, batch, actions), np.bool_)

    work = Workspace(network, batch)
    q = network.forward(x, work)
    loss = kernels.td_gradient(
        q,
        next_q,
        next_q,
        action,
        reward,
        discount,
        forbidden,
        np.float32(-np.inf),
        np.float32(np.inf),
        huber,
        work.q_gradient,
    )
    network.backward(work)

    criterion = torch.nn.SmoothL1Loss() if huber else torch.nn.MSELoss()
    losses = []
    for m, module in enumerate(members_of(network)):
        x_m = torch.from_numpy(x[m]).double()
        # At its corner ReLU's gradient depends on the last bit.
        assume(smallest_before_relu(module, x_m) > 1e-5)
        # Values that are nearly equal differ in their last bits alone, which LayerNorm magnifies.
        assume(smallest_spread(module, x_m) > 0.03)
        target = torch.from_numpy(reward[m] + discount[m] * next_q[m].max(axis=-1)).double()
        predicted = module(x_m).gather(1, torch.from_numpy(action[m])[:, None])[:, 0]
        expected_loss = criterion(predicted, target)
        expected_loss.backward()
        expected = flat_gradient(module)
        error = (network.gradient[m].double() - expected).abs().max()
        assert error <= 2e-5 * (1 + expected.abs().max())
        losses.append(expected_loss.item())
    assert loss == pytest.approx(np.mean(losses), rel=1e-4, abs=1e-5)


@settings(deadline=None, max_examples=60)
@given(**SHAPES)
def test_module_gives_equal_outputs(
    inputs: int,
    actions: int,
    hidden: list[int],
    layer_norm: bool,
    members: int,
    batch: int,
    seed: int,
) -> None:
    network, rng = random_network(inputs, actions, hidden, layer_norm, members, seed)
    x = rng.standard_normal((batch, inputs)).astype(np.float32)
    q = network.forward(x, Workspace(network, batch)).mean(axis=0)
    np.testing.assert_allclose(
        q, network.module()(torch.from_numpy(x)).detach().numpy(), rtol=1e-4, atol=1e-4
    )


def test_one_member_exports_an_ordinary_sequential() -> None:
    network = QNetwork(3, 2, (8, 4), layer_norm=True, rng=np.random.default_rng(0))
    module = network.module()
    assert [type(layer).__name__ for layer in module] == [  # type: ignore[arg-type]
        *("Linear", "LayerNorm", "ReLU") * 2,
        "Linear",
    ]


def test_module_is_a_copy() -> None:
    network = QNetwork(3, 2, (8,), rng=np.random.default_rng(0))
    module = network.module()
    before = module(torch.ones(1, 3))
    network.parameters.zero_()
    assert torch.equal(module(torch.ones(1, 3)), before)


def test_start_is_that_of_torch_linear_in_distribution() -> None:
    network = QNetwork(16, 4, (400,), rng=np.random.default_rng(0))
    first, last = network.layers
    flat = network.parameters[0].numpy()
    for layer, bound in ((first, 1 / 4), (last, 1 / 20)):
        values = flat[layer.start : layer.end]
        assert np.abs(values).max() <= bound
        assert values.std() == pytest.approx(bound / np.sqrt(3), rel=0.1)
        assert abs(values.mean()) < bound / 10


def test_members_start_apart_and_do_not_mix() -> None:
    network = QNetwork(3, 2, (8,), layer_norm=True, members=2, rng=np.random.default_rng(0))
    x = np.random.default_rng(1).standard_normal((5, 3)).astype(np.float32)
    work = Workspace(network, 5)
    before = network.forward(x, work).copy()
    assert not np.array_equal(before[0], before[1])
    network.parameters[1] += 1.0
    after = network.forward(x, work)
    np.testing.assert_array_equal(after[0], before[0])
    assert not np.array_equal(after[1], before[1])


def test_follows_by_copy_and_by_share() -> None:
    online = QNetwork(3, 2, (8,), rng=np.random.default_rng(0))
    target = QNetwork(3, 2, (8,))
    target.move_towards(online, 0.25)
    torch.testing.assert_close(target.parameters, online.parameters * 0.25)
    target.copy_from(online)
    assert torch.equal(target.parameters, online.parameters)
    online.parameters.zero_()
    assert target.parameters.abs().sum() > 0
