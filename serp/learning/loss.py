"""From a batch of samples to the gradient of the TD loss (paper, equations 2 and 3)."""

from __future__ import annotations

import numpy as np

from serp.learning import guided_kernels, kernels
from serp.learning.guidance import GuidedLearning
from serp.learning.network import QNetwork, Workspace
from serp.learning.samples import Samples
from serp.settings import LearnerSettings


class TDGradient:
    """Forward and backward passes of one gradient update.

    Args:
        online: the network.
        target: values the next states; the same network where there is no target network.
        settings: of the learner.
        guided: how it learns from a guide; None: not at all.
    """

    def __init__(
        self,
        online: QNetwork,
        target: QNetwork,
        settings: LearnerSettings,
        guided: GuidedLearning | None,
    ) -> None:
        self._online = online
        self._target = target
        self._guided = guided
        self._huber = settings.loss == "huber"
        apart = target is not online
        self._chooses = settings.double and apart
        self._filters = apart and guided is not None and guided.q_filter
        self._work = Workspace(online, settings.batch_size)
        self._next_work = Workspace(online, settings.batch_size)
        self._choice_work = Workspace(online, settings.batch_size if self._chooses else 0)
        self._filter_work = Workspace(online, settings.batch_size if self._filters else 0)

    def gradient(self, batch: Samples, lower: float, upper: float, margin_weight: float) -> float:
        """Writes the gradient of the loss on a batch into that of the network.

        Args:
            batch: samples ``[members, batch]``.
            lower: smallest possible value of a state.
            upper: largest possible value of a state.
            margin_weight: weight of imitation, ≥ 0.

        Returns:
            The mean loss over members and samples.
        """
        if self._filters and margin_weight > 0.0:
            self._target.forward(batch.observation, self._filter_work)
        self._target.forward(batch.next_observation, self._next_work)
        if self._chooses:
            self._online.forward(batch.next_observation, self._choice_work)
        self._online.forward(batch.observation, self._work)
        loss = self._loss(batch, np.float32(lower), np.float32(upper), np.float32(margin_weight))
        self._online.backward(self._work)
        return loss

    def _loss(
        self, batch: Samples, lower: np.float32, upper: np.float32, margin_weight: np.float32
    ) -> float:
        """The loss, after the forward passes; writes its gradient in Q."""
        work, next_q = self._work, self._next_work.q
        choice_q = self._choice_work.q if self._chooses else next_q
        guided, guide = self._guided, batch.guide
        loss: float
        if guided is None or guide is None:
            loss = kernels.td_gradient(
                work.q, next_q, choice_q,
                batch.action, batch.reward, batch.discount, batch.forbidden,
                lower, upper, self._huber, work.q_gradient,
            )  # fmt: skip
            return loss
        judge_q = self._filter_work.q if self._filters else work.q
        loss = guided_kernels.guided_td_gradient(
            work.q, next_q, choice_q, judge_q,
            batch.action, batch.reward, batch.discount, batch.forbidden,
            guide.action, guide.value, guide.next_action, guide.next_values,
            lower, upper, self._huber,
            guided.bootstrap_guide, guided.residual,
            np.float32(guided.margin), margin_weight, guided.q_filter,
            work.q_gradient,
        )  # fmt: skip
        return loss
