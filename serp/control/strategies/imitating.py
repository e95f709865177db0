"""Imitation of the planner as long as it is better, for strategies that hand over the lead."""

from __future__ import annotations

import numpy as np

from serp.control.strategies.strategy import Seed, Strategy
from serp.learning.guidance import Guidance, GuidedLearning
from serp.planning.action_map import ActionForecast
from serp.settings import Settings


class ImitatingStrategy(Strategy):
    """The learner imitates the planner's choice as long as the planner is better.

    A learner that only watches the planner never tries other actions, and its values for these are
    invented. So its values are trained to exceed them by a margin (Hester et al. 2018, arXiv
    1704.03732), with a weight that falls to 0 as the learner catches up (QDagger: Agarwal et al.
    2022, arXiv 2206.01626): `arbiter.imitation_weight` × (1 - 2ρ) while ρ < ½. The margin is one
    standard deviation of Q. Where all plans have the same value there is nothing to imitate.
    """

    def __init__(self, settings: Settings, seed: Seed = 0) -> None:
        super().__init__(settings, seed)
        weight = settings.arbiter.imitation_weight
        if weight > 0.0:
            self.guided = GuidedLearning(
                margin=1.0, margin_weight=weight, relative=True, q_filter=False
            )

    @property
    def margin_weight(self) -> float:
        """The weight of imitation, by how much more probably the planner is the better one."""
        return super().margin_weight * max(0.0, 1.0 - 2.0 * self.rho)

    def guidance(
        self, forecast: ActionForecast, action: int, following: ActionForecast | None
    ) -> Guidance | None:
        """Return the planner's choice, to be imitated unless all plans have the same value."""
        if self.guided is None:
            return None
        said = -1 if forecast.indifferent else forecast.choice
        return Guidance(said, 0.0, -1, np.zeros(len(forecast.value), np.float32))
