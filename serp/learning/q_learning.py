"""Gradient updates: the network, its target network and the optimiser."""

from __future__ import annotations

import math

import numpy as np

from serp import _core
from serp.errors import LearningFailure
from serp.learning.network import QNetwork, Workspace, aligned_zeros
from serp.learning.replay import Samples, type_F32
from serp.settings import LearnerSettings

_BETA1, _BETA2, _EPSILON = 0.9, 0.999, 1e-8


class Adam:
    """The Adam optimiser, in place, with the paper's β₁, β₂ and ε.

    The moments are stored without their factors (1 − β₁) and (1 − β₂), which are part of the step
    size instead: less arithmetic with the same result.

    Args:
        parameters: Contiguous float32 ``[members, P]``, changed by `step`.
        gradient: Likewise, read by `step`.
        learning_rate: The step size α > 0.
        largest_norm: Each member's gradient is scaled down to this Euclidean norm; None: never.
        average: Parameters that follow (Polyak averaging); ``[members, 0]`` for none.
        share: The fraction of the difference by which they follow in a step.

    Attributes:
        first, second: Σ β₁ᵗ⁻ⁱ gᵢ and Σ β₂ᵗ⁻ⁱ gᵢ², float32 ``[members, P]``.
        steps: Number of steps.
    """

    def __init__(
        self,
        parameters: type_F32,
        gradient: type_F32,
        learning_rate: float,
        largest_norm: float | None,
        average: type_F32,
        share: float,
    ) -> None:
        self._parameters, self._gradient = parameters, gradient
        self.first, self.second = (aligned_zeros(*parameters.shape) for _ in range(2))
        self._learning_rate = learning_rate
        self._largest_norm = math.inf if largest_norm is None else largest_norm
        self._average, self._share = average, share
        self.steps = 0

    def step(self) -> None:
        """Move the parameters against the gradient, and those that follow them."""
        self.steps += 1
        spread = math.sqrt((1.0 - _BETA2) / (1.0 - _BETA2**self.steps))
        rate = self._learning_rate * (1.0 - _BETA1) / (1.0 - _BETA1**self.steps) / spread
        _core.adam(
            self._parameters, self._gradient, self.first, self.second, rate, _EPSILON / spread,
            self._largest_norm, self._average, self._share,
        )  # fmt: skip


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
        self.updates = 0
        sizes = (input_size, *settings.hidden, action_count)
        norm, members = settings.layer_norm, settings.members
        self.online = QNetwork(sizes, layer_norm=norm, members=members, rng=rng)
        # Without a target network the network itself values the next state (paper, equation 3).
        self.target = self.online
        following = self.online.parameters[:, :0]
        self._work = Workspace(self.online, settings.batch_size)
        self._next_work = Workspace(self.online, settings.batch_size)
        self._choice_work = self._next_work
        if settings.target_polyak is not None:
            self.target = QNetwork(sizes, layer_norm=norm, members=members)
            following = self.target.parameters
            following[:] = self.online.parameters
            self._choice_work = Workspace(self.online, settings.batch_size)
        self.optimizer = Adam(
            self.online.parameters, self.online.gradient, settings.learning_rate,
            settings.gradient_clip, following, settings.target_polyak or 0.0,
        )  # fmt: skip

    def update(
        self, batch: Samples, bounds: tuple[float, float], imitation_weight: float, env_step: int
    ) -> float:
        """Do one gradient update on a batch ``[E, B]`` and return its loss.

        `bounds` are the smallest and the largest possible value of a state.

        Raises:
            LearningFailure: The loss is not finite; nothing has changed.
        """
        self.target.forward(batch.next_observation, self._next_work)
        if self.target is not self.online:
            self.online.forward(batch.next_observation, self._choice_work)
        self.online.forward(batch.observation, self._work)
        imitated, unit = None, 0.0
        if batch.imitated.size:
            imitated, unit = batch.imitated, _core.deviation(self._work.q)
        loss = _core.td_gradient(
            self._work.q, self._next_work.q, self._choice_work.q,
            batch.action, batch.reward, batch.discount, batch.forbidden, *bounds,
            imitated, unit, imitation_weight * unit, self._work.q_gradient,
        )  # fmt: skip
        self.online.backward(self._work)
        if not math.isfinite(loss):
            raise self.failure(f"the loss is {loss}", env_step, batch)
        self.optimizer.step()
        self.updates += 1
        return loss

    def arrays(self) -> dict[str, type_F32]:
        """Return all arrays that a gradient update changes: name → view."""
        arrays: dict[str, type_F32] = {
            "parameters": self.online.parameters,
            "adam_first": self.optimizer.first,
            "adam_second": self.optimizer.second,
        }
        if self.target is not self.online:
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
