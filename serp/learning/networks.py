"""What a gradient update changes: the network, its target network and the optimiser."""

from __future__ import annotations

import numpy as np

from serp.learning.network import QNetwork
from serp.learning.optimizer import Adam
from serp.learning.samples import type_F32
from serp.settings import LearnerSettings


class Networks:
    """The network, its target and its optimiser, of one learner.

    Args:
        input_size: numbers in one input, F ≥ 1.
        action_count: actions, A ≥ 1.
        settings: of the learner.
        rng: draws the start.
        start_at_zero: every Q-value is zero at the start, by the last layer.

    Attributes:
        online: the network that learns.
        target: values the next states; without a target network the same object.
        optimizer: changes `online`.
        updates: gradient updates done.
    """

    def __init__(
        self,
        input_size: int,
        action_count: int,
        settings: LearnerSettings,
        rng: np.random.Generator,
        *,
        start_at_zero: bool,
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
        if start_at_zero:
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

    def step(self) -> None:
        """Moves the network against its gradient, and lets the target network follow."""
        self.optimizer.step()
        self.updates += 1
        if self._period is not None:
            if self.updates % self._period == 0:
                self.target.copy_from(self.online)
        elif self._polyak is not None:
            self.target.move_towards(self.online, self._polyak)

    def not_finite(self) -> str | None:
        """The first of all numbers that is not finite, in words; None where all are."""
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

    def arrays(self) -> dict[str, type_F32]:
        """All that a gradient update changes, but for the two counts: name → view."""
        arrays: dict[str, type_F32] = {
            "parameters": self.online.parameters.numpy(),
            "adam_first": self.optimizer.first,
            "adam_second": self.optimizer.second,
        }
        if self.target is not self.online:
            arrays["target"] = self.target.parameters.numpy()
        return arrays
