"""Gradient updates: the network, its target network and the optimiser."""

from __future__ import annotations

import math

import numpy as np

from serp.errors import LearningFailure
from serp.learning.guidance import GuidedLearning
from serp.learning.loss import TDGradient
from serp.learning.network import QNetwork
from serp.learning.optimizer import Adam
from serp.learning.samples import Samples, type_F32
from serp.settings import LearnerSettings


class QLearning:
    """The network of a learner, its target network, and their gradient updates.

    Args:
        input_size: Numbers in one input, F ≥ 1.
        action_count: Actions, A ≥ 1.
        settings: The learner's settings.
        rng: Draws the initial weights.
        guided: How it learns from a guide; None: it does not. For residual learning every Q-value
            is initially zero, by the last layer.

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
        guided: GuidedLearning | None = None,
    ) -> None:
        self._period, self._polyak = settings.target_period, settings.target_polyak
        self.updates = 0
        self.online = QNetwork(
            input_size,
            action_count,
            settings.hidden,
            layer_norm=settings.layer_norm,
            members=settings.members,
            rng=rng,
        )
        if guided is not None and guided.residual:
            self.online.zero_output()
        # Without a target network the network itself values the next state (paper, equation 3).
        self.target = self.online
        if settings.has_target:
            self.target = self.online.another()
            self.target.copy_from(self.online)
        self.optimizer = Adam(
            self.online.parameters,
            self.online.gradient,
            settings.learning_rate,
            settings.gradient_clip,
        )
        self._td = TDGradient(self.online, self.target, settings, guided)

    def update(
        self,
        batch: Samples,
        bounds: tuple[float, float],
        imitation_weight: float,
        env_step: int,
    ) -> float:
        """Do one gradient update.

        Args:
            batch: Samples ``[members, batch]``.
            bounds: Smallest and largest possible value of a state.
            imitation_weight: Weight of imitation, ≥ 0.
            env_step: Env steps done, for messages.

        Returns:
            Its loss.

        Raises:
            LearningFailure: The loss is not finite; nothing has changed.
        """
        loss = self._td.gradient(batch, bounds, imitation_weight)
        if not math.isfinite(loss):
            raise self.failure(f"the loss is {loss}", env_step, batch)
        self.step()
        return loss

    def step(self) -> None:
        """Move the network against its gradient, and let the target network follow."""
        self.optimizer.step()
        self.updates += 1
        if self._period is not None:
            if self.updates % self._period == 0:
                self.target.copy_from(self.online)
        elif self._polyak is not None:
            self.target.move_towards(self.online, self._polyak)

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
        """Describe the first number that is not finite; None if all are finite."""
        for name, array in self.arrays().items():
            if not np.isfinite(array).all():
                member, column = np.argwhere(~np.isfinite(array))[0]
                what = {"parameters": "the", "target": "the target network's"}.get(
                    name, "Adam's sums for the"
                )
                return (
                    f"{what} {self.online.place_of(int(column))} in network {member + 1} of "
                    f"{len(array)}: {array[member, column]}"
                )
        return None

    def failure(self, what: str, env_step: int, batch: Samples | None = None) -> LearningFailure:
        """Return the error that names what is not finite: parameters before other values.

        Args:
            what: The failure.
            env_step: Env steps done.
            batch: The network's inputs; None: none.
        """
        first = self.not_finite()
        if first is None and batch is not None:
            first = _largest_of(batch)
        return LearningFailure(
            f"learner: {what} in gradient update {self.updates + 1}, env step {env_step}. "
            f"The first number that is not finite is {first}. Smaller inputs or rewards, or a "
            "smaller learner.learning_rate or learner.gradient_clip, keep the numbers small"
        )


def _largest_of(batch: Samples) -> str:
    given = {
        "input": batch.observation,
        "next input": batch.next_observation,
        "reward": batch.reward,
    }
    if batch.guide is not None:
        given["value of the guide"] = batch.guide.value
    name, array = max(given.items(), key=lambda item: float(np.abs(item[1]).max()))
    place = np.unravel_index(int(np.abs(array).argmax()), array.shape)
    at = f" {place[-1]}" if array.ndim > batch.reward.ndim else ""
    return (
        "a value of the network; all its parameters are finite, and the largest number that it "
        f"was given is {name}{at}: {array[place]:g}"
    )
