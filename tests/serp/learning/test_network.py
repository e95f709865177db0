"""Outputs and gradient of the network, and steps of the optimiser, are those of torch."""

import numpy as np
import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from serp import _core
from serp._core import QNetwork
from serp.learning.q_learning import draw


def random_network(inputs, actions, hidden, layer_norm, members, seed):
    rng = np.random.default_rng(seed)
    network = QNetwork((inputs, *hidden, actions), layer_norm, members)
    draw(network, rng)
    noise = rng.standard_normal(network.parameters.shape, np.float32) * np.float32(0.3)
    network.parameters[...] += noise  # gains and shifts that matter
    return network, rng


def module_of(network, member):
    """An independent copy of a member, ``[batch, F]`` → ``[batch, A]``."""
    flat = torch.from_numpy(network.parameters[member].copy())
    stack = []
    for k, layer in enumerate(network.layers):
        weight = flat[layer.start : layer.bias].reshape(layer.inputs, layer.outputs)
        vectors = flat[layer.bias : layer.end].reshape(-1, layer.outputs)
        linear = torch.nn.Linear(layer.inputs, layer.outputs)
        linear.load_state_dict({"weight": weight.T, "bias": vectors[0]})
        stack.append(linear)
        if layer.normalized:
            norm = torch.nn.LayerNorm(layer.outputs, eps=_core.NORM_EPSILON)
            norm.load_state_dict({"weight": vectors[1], "bias": vectors[2]})
            stack.append(norm)
        if k + 1 < len(network.layers):
            stack.append(torch.nn.ReLU())
    return torch.nn.Sequential(*stack)


def flat_gradient(module):
    parts = []
    for layer in module:
        if isinstance(layer, torch.nn.Linear):
            parts += [layer.weight.grad.T, layer.bias.grad]
        elif isinstance(layer, torch.nn.LayerNorm):
            parts += [layer.weight.grad, layer.bias.grad]
    return torch.cat([part.reshape(-1) for part in parts])


@torch.no_grad()
def well_conditioned(module, x):
    """Whether no ReLU is at its corner and no LayerNorm magnifies the last bits of its inputs."""
    for layer in module:
        if isinstance(layer, torch.nn.ReLU) and float(x.abs().min()) <= 1e-5:
            return False
        if isinstance(layer, torch.nn.LayerNorm):
            spread = x.std(-1, correction=0)
            if bool(((spread > 0) & (spread <= 0.1)).any()):
                return False
        x = layer(x)
    return True


@settings(deadline=None, max_examples=80)
@given(
    inputs=st.integers(1, 7),
    actions=st.integers(1, 5),
    hidden=st.lists(st.integers(1, 24), max_size=3),
    layer_norm=st.booleans(),
    members=st.integers(1, 3),
    batch=st.integers(1, 17),
    seed=st.integers(0, 2**32),
)
def test_outputs_and_gradient_are_those_of_torch(
    inputs, actions, hidden, layer_norm, members, batch,
    seed
):  # fmt: skip
    network, rng = random_network(inputs, actions, hidden, layer_norm, members, seed)
    x = rng.standard_normal((members, batch, inputs)).astype(np.float32)
    slope = rng.standard_normal((members, batch, actions)).astype(np.float32)
    q, gradient = network.gradient(x, slope)
    modules = [module_of(network, m).double() for m in range(members)]
    for m, module in enumerate(modules):
        x_m = torch.from_numpy(x[m]).double()
        assume(well_conditioned(module, x_m))
        expected_q = module(x_m)
        np.testing.assert_allclose(q[m], expected_q.detach().numpy(), rtol=1e-4, atol=1e-4)
        (expected_q * torch.from_numpy(slope[m]).double()).sum().backward()
        expected = flat_gradient(module)
        error = (torch.from_numpy(gradient[m]).double() - expected).abs().max()
        assert error <= 2e-5 * (1 + expected.abs().max())
    mean = torch.stack([module(torch.from_numpy(x[0]).double()) for module in modules]).mean(0)
    np.testing.assert_allclose(network.q(x[0]), mean.detach().numpy(), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("largest_norm", [None, 0.5])
@pytest.mark.parametrize("members", [1, 3])
def test_steps_are_those_of_torchs_adam(members, largest_norm):
    rng = np.random.default_rng(0)
    norm = np.inf if largest_norm is None else largest_norm
    ours = _core.QLearning((24, 8), False, members, 1, 0.01, norm, 0.1)
    start = rng.standard_normal((members, 200)).astype(np.float32)
    ours.online.parameters[...] = start
    slow = torch.zeros(members, 200)
    theirs = [torch.nn.Parameter(torch.from_numpy(row.copy())) for row in start]
    optimizer = torch.optim.Adam(theirs, lr=0.01, fused=True)

    for step in range(100):
        size = 10.0 ** rng.uniform(-4, 1)
        gradient = torch.from_numpy((rng.standard_normal((members, 200)) * size).astype(np.float32))
        gradient[:, :20] = 0.0 if step % 7 else 1e-20
        for parameter, row in zip(theirs, gradient, strict=True):
            parameter.grad = row.clone()
            if largest_norm is not None:
                torch.nn.utils.clip_grad_norm_([parameter], largest_norm)
        optimizer.step()
        ours.step(gradient.numpy())
        expected = torch.stack([p.detach() for p in theirs])
        parameters = torch.from_numpy(ours.online.parameters)
        torch.testing.assert_close(parameters, expected, rtol=1e-5, atol=1e-5)
        slow.lerp_(parameters, 0.1)
        average = torch.from_numpy(ours.target.parameters)
        torch.testing.assert_close(average, slow, rtol=1e-5, atol=1e-5)
