"""Imitation of the planner while its model is reliable, for strategies that hand over the lead."""

from __future__ import annotations

from serp.control.strategies.advice import advice
from serp.control.strategies.strategy import Seed, Situation, Strategy
from serp.learning.guidance import Guidance, GuidedLearning
from serp.planning.action_map import ActionForecast
from serp.settings import Settings


class ImitatingStrategy(Strategy):
    """While the model is reliable, the learner imitates the planner's choice.

    Its loss has the weight `arbiter.imitation_weight` (Hester et al. 2018, arXiv 1704.03732).
    """

    def __init__(self, settings: Settings, seed: Seed = 0, *, adapts: bool = True) -> None:
        super().__init__(settings, seed, adapts=adapts)
        weight = settings.arbiter.imitation_weight
        if adapts and weight > 0.0:
            self.guided = GuidedLearning(margin_weight=weight, q_filter=False)
        self._model_reliable = False

    def _notice(self, situation: Situation) -> None:
        """Remember whether the model is reliable."""
        self._model_reliable = situation.model_reliable

    def guidance(
        self, forecast: ActionForecast, action: int, following: ActionForecast | None
    ) -> Guidance | None:
        """Return the planner's choice, to be imitated if the model is reliable."""
        if self.guided is None:
            return None
        imitate = self._model_reliable and not forecast.indifferent
        return advice(forecast, action, following, scale=1.0, imitate=imitate)
