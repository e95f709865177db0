"""Export of networks as ordinary torch modules."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from serp.learning import kernels
from serp.learning.network import QNetwork
from serp.learning.symmetry_group import SymmetryGroup


def module_of(network: QNetwork, symmetry: SymmetryGroup | None = None) -> torch.nn.Module:
    """Return an independent copy of a network, ``[batch, F]`` → ``[batch, A]``.

    It is a `torch.nn.Sequential`; with several members or symmetries, a module that returns the
    mean over them.
    """
    modules = [_sequential(network, member) for member in range(network.members)]
    module = modules[0] if network.members == 1 else MeanOfMembers(modules)
    if symmetry is None:
        return module
    used = slice(symmetry.averaged)
    columns, signs, actions = (
        torch.from_numpy(array[used].copy())
        for array in (symmetry.columns, symmetry.signs, symmetry.actions)
    )
    return MeanOfImages(module, columns, signs, actions)


def _sequential(network: QNetwork, member: int) -> torch.nn.Sequential:
    flat = network.parameters[member]
    stack: list[torch.nn.Module] = []
    for layer in network.layers:
        vectors = flat[layer.bias : layer.end].reshape(-1, layer.outputs)
        linear = torch.nn.Linear(layer.inputs, layer.outputs)
        with torch.no_grad():
            weight = flat[layer.start : layer.bias].reshape(layer.inputs, layer.outputs)
            linear.weight.copy_(weight.T)
            linear.bias.copy_(vectors[0])
        stack.append(linear)
        if layer.normalized:
            norm = torch.nn.LayerNorm(layer.outputs, eps=kernels.NORM_EPSILON)
            with torch.no_grad():
                norm.weight.copy_(vectors[1])
                norm.bias.copy_(vectors[2])
            stack.append(norm)
        if layer is not network.layers[-1]:
            stack.append(torch.nn.ReLU())
    return torch.nn.Sequential(*stack)


class MeanOfMembers(torch.nn.Module):
    """The mean output of several networks."""

    def __init__(self, members: Sequence[torch.nn.Module]) -> None:
        super().__init__()
        self.members = torch.nn.ModuleList(members)

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return ``[batch, A]`` of ``[batch, F]``."""
        return torch.stack([member(inputs) for member in self.members]).mean(0)


class MeanOfImages(torch.nn.Module):
    """The mean output over a symmetry group; see `serp.learning.symmetry_group`.

    Args:
        inner: Maps ``[batch, F]`` → ``[batch, A]``.
        columns: int64 ``[K, F]``.
        signs: float32 ``[K, F]``.
        actions: int64 ``[K, A]``.
    """

    columns: torch.Tensor
    signs: torch.Tensor
    actions: torch.Tensor

    def __init__(
        self,
        inner: torch.nn.Module,
        columns: torch.Tensor,
        signs: torch.Tensor,
        actions: torch.Tensor,
    ) -> None:
        super().__init__()
        self.inner = inner
        self.register_buffer("columns", columns)
        self.register_buffer("signs", signs)
        self.register_buffer("actions", actions)

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return ``[batch, A]`` of ``[batch, F]``."""
        images = zip(self.columns, self.signs, self.actions, strict=True)
        return torch.stack([self.inner(inputs[:, c] * s)[:, a] for c, s, a in images]).mean(0)
