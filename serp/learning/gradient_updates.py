"""Gradient updates: the network, its target network and the optimiser."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from serp import _core
from serp.errors import LearningFailure
from serp.learning.replay import ReplayBuffer, type_F32
from serp.settings import LearnerSettings

_LARGEST_NORM: Final = 10.0  # of the gradient of one network that has a target network


class QLearning(_core.QLearning):
    """The network of a learner, its target network, and their gradient updates.

    The computation is compiled: `network.cpp` and `gradient_updates.cpp`. All members' parameters
    are one float32 array ``[E, P]``. The optimiser is Adam with the paper's β₁, β₂ and ε; `steps`
    is the number of gradient updates. Equal numbers give equal bits on one kind of machine.
    """

    def __init__(
        self,
        input_size: int,
        action_count: int,
        settings: LearnerSettings,
        rng: np.random.Generator,
    ) -> None:
        self._drawn = settings.members * settings.batch_size
        super().__init__(
            (input_size, *settings.hidden, action_count), settings.layer_norm, settings.members,
            settings.batch_size, settings.learning_rate,
            math.inf if settings.target_polyak is None else _LARGEST_NORM,
            settings.target_polyak,
        )  # fmt: skip
        draw(self.online, rng)
        if self.target is not None:
            self.target.parameters[...] = self.online.parameters

    def learn(self, replay: ReplayBuffer, imitation_weight: float, env_step: int) -> float:
        """Do one gradient update on samples of the replay memory and return its loss.

        A batch ``[B]`` is drawn for each member. Without a target network the network itself values
        the next state (paper, equation 3).

        Raises:
            LearningFailure: The loss is not finite; no parameter has changed.
        """
        loss = self.update(replay.compiled, replay.draw(self._drawn), imitation_weight)
        if not math.isfinite(loss):
            raise self.failure(f"the loss is {loss}", env_step, replay)
        return loss

    def arrays(self) -> dict[str, type_F32]:
        """Return all arrays that a gradient update changes: name → view."""
        arrays: dict[str, type_F32] = {
            "parameters": self.online.parameters,
            "adam_first": self.first,
            "adam_second": self.second,
        }
        if self.target is not None:
            arrays["target"] = self.target.parameters
        return arrays

    def not_finite(self) -> str | None:
        """Return where the first number is that is not finite; None if all are finite."""
        for name, array in self.arrays().items():
            if not np.isfinite(array).all():
                column = np.argwhere(~np.isfinite(array))[0, 1]
                layer = sum(layer.end <= column for layer in self.online.layers) + 1
                return f"in the {name} of layer {layer}"
        return None

    def failure(
        self, what: str, env_step: int, replay: ReplayBuffer | None = None
    ) -> LearningFailure:
        """Return the error that names what is not finite: parameters before the largest input."""
        first = self.not_finite()
        if first is None and replay is not None:
            names = ("observation", "next_observation", "reward")
            size, name = max((np.abs(replay.samples[name]).max(), name) for name in names)
            first = f"a value of the network; the largest of its inputs is a {name}: {size:g}"
        return LearningFailure(
            f"learner: {what} in gradient update {self.steps + 1}, env step {env_step}. "
            f"The first non-finite number is {first}. Smaller inputs or rewards, or a "
            "smaller learner.learning_rate, keep the numbers small"
        )


def draw(network: _core.QNetwork, rng: np.random.Generator) -> None:
    """Draw weights and biases, uniform in ±1/√inputs as in `torch.nn.Linear`; gains become 1."""
    parameters = network.parameters
    for layer in network.layers:
        gain, shift = layer.bias + layer.outputs, layer.bias + 2 * layer.outputs
        values = rng.random((network.members, gain - layer.start), np.float32)
        scale = np.float32(1.0 / math.sqrt(layer.inputs))
        parameters[:, layer.start : gain] = (2 * values - 1) * scale
        if layer.normalized:
            parameters[:, gain:shift] = 1.0
