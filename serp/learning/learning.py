"""Gradient updates: the network, its target network and the optimiser."""

from __future__ import annotations

import math

import numpy as np

from serp.errors import LearningFailure
from serp.learning.loss import TDGradient
from serp.learning.network import QNetwork
from serp.learning.optimizer import Adam
from serp.learning.samples import Samples, type_F32
from serp.settings import LearnerSettings


class QLearning:
    """The network of a learner, its target network, and their gradient updates.

    Attributes:
        online: The network that learns.
        target: The target network; without one the same object as `online`.
        optimizer: The optimiser of `online`.
        updates: Number of gradient updates.
    """

    def __init__(
        self,
        input_size: int,
        action_count: int,
        settings: LearnerSettings,
        rng: np.random.Generator,
    ) -> None:
        self._period = settings.target_period
        self.updates = 0
        sizes = (input_size, *settings.hidden, action_count)
        norm, members = settings.layer_norm, settings.members
        self.online = QNetwork(sizes, layer_norm=norm, members=members, rng=rng)
        # Without a target network the network itself values the next state (paper, equation 3).
        self.target = self.online
        if settings.has_target:
            self.target = QNetwork(sizes, layer_norm=norm, members=members)
            self.target.parameters.copy_(self.online.parameters)
        follows = settings.target_polyak is not None
        self.optimizer = Adam(
            self.online.parameters,
            self.online.gradient,
            settings.learning_rate,
            settings.gradient_clip,
            self.target.parameters if follows else None,
            settings.target_polyak or 0.0,
        )
        self._td = TDGradient(self.online, self.target, settings)

    def update(
        self,
        batch: Samples,
        bounds: tuple[float, float],
        imitation_weight: float,
        env_step: int,
    ) -> float:
        """Do one gradient update and return its loss; the arguments are those of `TDGradient`.

        Raises:
            LearningFailure: The loss is not finite; nothing has changed.
        """
        loss = self._td.gradient(batch, bounds, imitation_weight)
        if not math.isfinite(loss):
            raise self.failure(f"the loss is {loss}", env_step, batch)
        self.step()
        return loss

    def step(self) -> None:
        """Move the network against its gradient; the target network follows."""
        self.optimizer.step()
        self.updates += 1
        if self._period is not None and self.updates % self._period == 0:
            self.target.parameters.copy_(self.online.parameters)

    def arrays(self) -> dict[str, type_F32]:
        """Return all arrays that a gradient update changes: name → view."""
        arrays: dict[str, type_F32] = {
            "parameters": self.online.parameters.numpy(),
            "adam_first": self.optimizer.first,
            "adam_second": self.optimizer.second,
        }
        if self.target is not self.online:
            arrays["target"] = self.target.parameters.numpy()
        return arrays

    def not_finite(self) -> str | None:
        """Return where the first number is that is not finite; None if all are finite."""
        for name, array in self.arrays().items():
            if not np.isfinite(array).all():
                column = np.argwhere(~np.isfinite(array))[0, 1]
                layer = sum(layer.end <= column for layer in self.online.layers) + 1
                return f"in the {name} of layer {layer}"
        return None

    def failure(self, what: str, env_step: int, batch: Samples | None = None) -> LearningFailure:
        """Return the error that names what is not finite: parameters before the largest input."""
        first = self.not_finite()
        if first is None and batch is not None:
            names = ("observation", "next_observation", "reward")
            size, name = max((np.abs(getattr(batch, name)).max(), name) for name in names)
            first = f"a value of the network; the largest of its inputs is a {name}: {size:g}"
        return LearningFailure(
            f"learner: {what} in gradient update {self.updates + 1}, env step {env_step}. "
            f"The first number that is not finite is {first}. Smaller inputs or rewards, or a "
            "smaller learner.learning_rate or learner.gradient_clip, keep the numbers small"
        )
