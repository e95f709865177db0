"""Outputs and gradient of the network, and steps of the optimiser, are those of torch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from serp import _core
from serp._core import QNetwork
from serp.learning.q_learning import draw


def random_network(
    inputs: int, actions: int, hidden: list[int], layer_norm: bool, members: int, seed: int
) -> tuple[QNetwork, np.random.Generator]:
    rng = np.random.default_rng(seed)
    network = QNetwork((inputs, *hidden, actions), layer_norm, members)
    draw(network, rng)
    noise = rng.standard_normal(network.parameters.shape, np.float32) * np.float32(0.3)
    network.parameters[...] += noise  # gains and shifts that matter
    return network, rng


def module_of(network: QNetwork) -> torch.nn.Module:
    """Return an independent copy of a network, ``[batch, F]`` → ``[batch, A]``.

    It is a `torch.nn.Sequential`; with several members, a module that returns the mean over them.
    """
    members = [_sequential(network, member) for member in range(network.members)]
    return members[0] if len(members) == 1 else MeanModule(members)


def _sequential(network: QNetwork, member: int) -> torch.nn.Sequential:
    flat = torch.from_numpy(network.parameters[member].copy())
    stack: list[torch.nn.Module] = []
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


class MeanModule(torch.nn.Module):
    """The mean output of several networks."""

    def __init__(self, members: Sequence[torch.nn.Module]) -> None:
        super().__init__()
        self.members = torch.nn.ModuleList(members)

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return ``[batch, A]`` of ``[batch, F]``."""
        return torch.stack([member(inputs) for member in self.members]).mean(0)


def flat_gradient(module: torch.nn.Sequential) -> torch.Tensor:
    parts = []
    for layer in module:
        if isinstance(layer, torch.nn.Linear):
            parts += [layer.weight.grad.T, layer.bias.grad]
        elif isinstance(layer, torch.nn.LayerNorm):
            parts += [layer.weight.grad, layer.bias.grad]
    return torch.cat([part.reshape(-1) for part in parts])


@torch.no_grad()
def well_conditioned(module: torch.nn.Sequential, x: torch.Tensor) -> bool:
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


@settings(deadline=None, max_examples=150)
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
    inputs: int, actions: int, hidden: list[int], layer_norm: bool, members: int, batch: int,
    seed: int,
) -> None:  # fmt: skip
    network, rng = random_network(inputs, actions, hidden, layer_norm, members, seed)
    x = rng.standard_normal((members, batch, inputs)).astype(np.float32)
    slope = rng.standard_normal((members, batch, actions)).astype(np.float32)
    q, gradient = network.gradient(x, slope)
    whole = module_of(network).double()
    modules = list(whole.members) if isinstance(whole, MeanModule) else [whole]
    for m, module in enumerate(modules):
        x_m = torch.from_numpy(x[m]).double()
        assume(well_conditioned(module, x_m))  # type: ignore[arg-type]
        expected_q = module(x_m)
        np.testing.assert_allclose(q[m], expected_q.detach().numpy(), rtol=1e-4, atol=1e-4)
        (expected_q * torch.from_numpy(slope[m]).double()).sum().backward()
        expected = flat_gradient(module)  # type: ignore[arg-type]
        error = (torch.from_numpy(gradient[m]).double() - expected).abs().max()
        assert error <= 2e-5 * (1 + expected.abs().max())
    mean = network.q(x[0])
    exported = whole(torch.from_numpy(x[0]).double()).detach().numpy()
    np.testing.assert_allclose(mean, exported, rtol=1e-4, atol=1e-4)


def test_start_is_that_of_torch_linear_in_distribution() -> None:
    network = QNetwork((16, 400, 4))
    draw(network, np.random.default_rng(0))
    first, last = network.layers
    flat = network.parameters[0]
    for layer, bound in ((first, 1 / 4), (last, 1 / 20)):
        values = flat[layer.start : layer.end]
        assert np.abs(values).max() <= bound
        assert values.std() == pytest.approx(bound / np.sqrt(3), rel=0.1)
        assert abs(values.mean()) < bound / 10


@pytest.mark.parametrize("largest_norm", [None, 0.5])
@pytest.mark.parametrize("members", [1, 3])
def test_steps_are_those_of_torchs_adam(members: int, largest_norm: float | None) -> None:
    rng = np.random.default_rng(0)
    norm = np.inf if largest_norm is None else largest_norm
    ours = _core.QLearning((24, 8), False, members, 1, 0.01, norm, 0.1)
    start = rng.standard_normal((members, 200)).astype(np.float32)
    ours.online.parameters[...] = start
    assert ours.target is not None
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
