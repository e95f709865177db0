"""Learning from demonstrations of the planner, with a margin loss (DQfD, Hester et al. 2018)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from serp._util.saved_state import Saved
from serp.control.protocols import Proposer
from serp.control.strategies.advice import advice
from serp.control.strategies.strategy import Seed, Situation, Strategy
from serp.learning.dqn import Proposal
from serp.learning.guidance import Guidance, GuidedLearning
from serp.planning.action_map import ActionForecast
from serp.settings import Settings


class Demonstrations(Strategy):
    """The planner demonstrates for some env steps, then the learner acts.

    Deep Q-learning from Demonstrations (Hester et al. 2018, arXiv 1704.03732): on demonstrated
    samples a margin loss, in addition to the TD loss, makes the Q of the planner's action a margin
    larger than that of any other, unless the target network values another action more (the
    Q-filter of Nair et al. 2018, arXiv 1709.10089). Demonstrations stay in the replay memory
    as long as there is room (`learner.buffer_size`).
    """

    reads = ("guide.imitation_steps", "guide.margin")

    def __init__(self, settings: Settings, seed: Seed = 0) -> None:
        super().__init__(settings, seed)
        margin = settings.guide.margin
        self.guided = GuidedLearning(margin=margin, margin_weight=1.0, q_filter=True)
        self._step = 0

    @property
    def _demonstrating(self) -> bool:
        return self._step < self._settings.guide.imitation_steps

    @property
    def rho(self) -> float:
        """0 during the demonstration, then 1."""
        return 0.0 if self._demonstrating else 1.0

    @property
    def turns(self) -> str:
        """In words: who acts now."""
        return "the planner's choice" if self._demonstrating else self.choice

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return None during the demonstration, then the learner's proposal."""
        return None if self._demonstrating else learner.propose(situation.admissible)

    def guidance(
        self, forecast: ActionForecast, action: int, following: ActionForecast | None
    ) -> Guidance | None:
        """Return the planner's action, to be imitated if it was demonstrated."""
        shown = self._demonstrating and action == forecast.choice
        return advice(forecast, action, following, scale=1.0, imitate=shown)

    def end_unit(self, unit: str) -> None:
        """Count env steps."""
        self._step += unit == "step"

    def state_dict(self) -> dict[str, Any]:
        """Return JSON values that `load_state_dict` restores exactly."""
        return {"step": self._step}

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned."""
        self._step = Saved("strategy", {}, meta).whole("step")
