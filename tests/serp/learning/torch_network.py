"""A network as an ordinary torch module: what its kernels are compared with."""

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
    members = [_sequential(network, member) for member in range(network.members)]
    if symmetry is None and len(members) == 1:
        return members[0]
    group = symmetry or SymmetryGroup(network.sizes[0], network.sizes[-1])
    return MeanModule(members, group)


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
    """The mean output of several networks over a symmetry group."""

    columns: torch.Tensor
    signs: torch.Tensor
    actions: torch.Tensor

    def __init__(self, members: Sequence[torch.nn.Module], group: SymmetryGroup) -> None:
        super().__init__()
        self.members = torch.nn.ModuleList(members)
        for name in ("columns", "signs", "actions"):
            array = getattr(group, name)[: group.averaged]
            self.register_buffer(name, torch.from_numpy(array.copy()))

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return ``[batch, A]`` of ``[batch, F]``."""
        images = zip(self.columns, self.signs, self.actions, strict=True)
        each = [m(inputs[:, c] * s)[:, a] for c, s, a in images for m in self.members]
        return torch.stack(each).mean(0)
