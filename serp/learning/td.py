"""From a batch of samples to the gradient of the TD loss (paper, equations 2 and 3)."""

from __future__ import annotations

import numpy as np

from serp.learning import guided_kernels, kernels
from serp.learning.guidance import GuidedLearning
from serp.learning.network import QNetwork, Workspace
from serp.learning.samples import Samples, type_F32
from serp.learning.settings import DQNSettings


class TDGradient:
    """Forward and backward passes of one gradient update, of one learner or several alike.

    Args:
        online: the network, or those of several learners, one learner's members after another's.
        target: values the next states; the same network where there is no target network.
        settings: of every learner.
        guided: of every learner; None where none learns from a guide.
        learners: how many, L ≥ 1.
    """

    def __init__(
        self,
        online: QNetwork,
        target: QNetwork,
        settings: DQNSettings,
        guided: GuidedLearning | None,
        learners: int = 1,
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

        choice = self._choice_work if self._chooses else self._next_work
        judge = self._filter_work if self._filters else self._work
        arrays = (self._work.q, self._next_work.q, choice.q, judge.q, self._work.q_gradient)
        members = online.members // learners
        self._views = [
            tuple(array[members * i : members * (i + 1)] for array in arrays)
            for i in range(learners)
        ]

    def forward(self, observation: type_F32, next_observation: type_F32, imitates: bool) -> None:
        """The passes that the losses need, of all learners.

        Args:
            observation: ``[L · members, batch, F]``; `backward` reads it again.
            next_observation: likewise.
            imitates: whether the weight of imitation is above 0 for any of them.
        """
        if imitates and self._filters:
            self._target.forward(observation, self._filter_work)
        self._target.forward(next_observation, self._next_work)
        if self._chooses:
            self._online.forward(next_observation, self._choice_work)
        self._online.forward(observation, self._work)

    def loss(
        self, learner: int, batch: Samples, lower: float, upper: float, margin_weight: float
    ) -> float:
        """The loss of one learner, after `forward`; prepares `backward`.

        Args:
            learner: its number, below L.
            batch: its samples ``[members, batch]``.
            lower: smallest possible value of a state.
            upper: largest possible value of a state.
            margin_weight: weight of imitation.

        Returns:
            The mean over its members and samples.
        """
        q, next_q, choice_q, judge_q, q_gradient = self._views[learner]
        guided, guide = self._guided, batch.guide
        loss: float
        if guided is None or guide is None:
            loss = kernels.td_gradient(
                q, next_q, choice_q,
                batch.action, batch.reward, batch.discount, batch.forbidden,
                np.float32(lower), np.float32(upper), self._huber, q_gradient,
            )  # fmt: skip
            return loss
        loss = guided_kernels.guided_td_gradient(
            q, next_q, choice_q, judge_q,
            batch.action, batch.reward, batch.discount, batch.forbidden,
            guide.action, guide.value, guide.next_action, guide.next_values,
            np.float32(lower), np.float32(upper), self._huber,
            guided.bootstrap_guide, guided.residual,
            np.float32(guided.margin), np.float32(margin_weight), guided.q_filter,
            q_gradient,
        )  # fmt: skip
        return loss

    def backward(self) -> None:
        """Writes the gradient of every learner's loss, once all of them are known."""
        self._online.backward(self._work)
