"""A network as an ordinary torch module: what its kernels are compared with."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from serp.learning import kernels
from serp.learning.network import QNetwork


def module_of(network: QNetwork) -> torch.nn.Module:
    """Return an independent copy of a network, ``[batch, F]`` → ``[batch, A]``.

    It is a `torch.nn.Sequential`; with several members, a module that returns the mean over them.
    """
    members = [_sequential(network, member) for member in range(network.members)]
    return members[0] if len(members) == 1 else MeanModule(members)


def _sequential(network: QNetwork, member: int) -> torch.nn.Sequential:
    flat = torch.from_numpy(network.parameters[member].copy())
    stack: list[torch.nn.Module] = []
    for layer in network.layers:
        weight = flat[layer.start : layer.bias].reshape(layer.inputs, layer.outputs)
        vectors = flat[layer.bias : layer.end].reshape(-1, layer.outputs)
        linear = torch.nn.Linear(layer.inputs, layer.outputs)
        linear.load_state_dict({"weight": weight.T, "bias": vectors[0]})
        stack.append(linear)
        if layer.normalized:
            norm = torch.nn.LayerNorm(layer.outputs, eps=kernels.NORM_EPSILON)
            norm.load_state_dict({"weight": vectors[1], "bias": vectors[2]})
            stack.append(norm)
        if layer is not network.layers[-1]:
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
