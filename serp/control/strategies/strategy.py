"""The base class of strategies: ways in which planner and learner share the decisions.

A strategy only proposes; what it proposes passes `serp.control.arbiter.Arbiter`, so that
the vetoes hold under every strategy.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from serp.control.model_confidence import ModelConfidence
from serp.control.protocols import Mask, Proposer, Values
from serp.learning.dqn import Proposal
from serp.planning.action_map import ActionForecast

if TYPE_CHECKING:
    from serp.learning.guidance import Guidance, GuidedLearning
    from serp.settings import Settings


Seed = int | np.random.SeedSequence


class Situation(NamedTuple):
    """What a strategy knows of the state that is to be decided on.

    Attributes:
        forecast: The planner's view.
        admissible: `[E]` actions that no veto refuses.
        explorable: `[E]` actions to explore among; None for all.
        confidence: How far the model can be relied on.
    """

    forecast: ActionForecast
    admissible: Mask
    explorable: Mask | None
    confidence: ModelConfidence = ModelConfidence.OPEN


class Strategy:
    """How planner and learner share the decisions. This base class always asks the learner.

    A strategy proposes; `serp.Arbiter` decides, so that the vetoes hold under every strategy. A
    subclass is found by name through the entry-point group `serp.strategies`.

    Args:
        settings: All settings.
        seed: Seed of its draws, where it draws.
        adapts: Whether the model adapts. One that does not is never known to predict well.

    Attributes:
        reads: The settings of its own, as `guide.margin`; other strategies do not read them.
        guided: How the learner is to use what the planner says; None for not at all.
    """

    reads: ClassVar[tuple[str, ...]] = ()
    guided: GuidedLearning | None = None

    def __init__(self, settings: Settings, seed: Seed = 0, *, adapts: bool = True) -> None:
        self._settings = settings

    @property
    def rho(self) -> float:
        """The probability that the learner is asked next."""
        return 1.0

    @property
    def choice(self) -> str:
        """In words: what `propose_greedily` returns."""
        return "the learner's choice"

    @property
    def baseline(self) -> str:
        """In words: what `propose_baseline` returns."""
        return "the learner's choice"

    @property
    def turns(self) -> str:
        """In words: what `propose` returns now, exploration left out."""
        return self.choice

    @property
    def margin_weight(self) -> float:
        """Weight of the learner's imitation loss from now on."""
        return 0.0 if self.guided is None else self.guided.margin_weight

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return the learner's proposal, or None where it is the planner's turn."""
        return learner.propose(situation.explorable)

    def propose_greedily(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return what the trained policy does: as `propose`, without exploration or draw."""
        return learner.propose_greedily()

    def propose_baseline(self, situation: Situation, learner: Proposer) -> Proposal:
        """Return what the learner does without planner and veto."""
        return learner.propose_greedily(base=self.base(situation.forecast))

    def forked(self, seed: np.random.SeedSequence) -> Strategy:
        """Return a copy that stands at the beginning of an episode.

        What it is asked changes nothing here.

        Args:
            seed: Seed of its draws, where it draws.
        """
        return copy.copy(self)

    def base(self, forecast: ActionForecast) -> Values | None:
        """Return `[E]` what belongs to the learner's Q beside its network; None for nothing."""
        return None

    def allowed(self, forecast: ActionForecast, admissible: Mask) -> Mask:
        """Return `[E]` the actions that the value of a state is the best of."""
        return admissible

    def guidance(
        self, forecast: ActionForecast, action: int, following: ActionForecast | None
    ) -> Guidance | None:
        """Return what the planner said about one env step, where the learner uses it.

        Args:
            forecast: Of the state that was acted in.
            action: The executed environment action.
            following: Forecast of the next state; None where the episode ended there.
        """
        return None

    def end_unit(self, unit: str) -> None:
        """Notice the end of a unit: `step`, `episode` or a counter of the environment."""

    def end_episode(self, return_: float, length: int) -> None:
        """Notice the end of an episode of training."""

    def state_dict(self) -> dict[str, Any]:
        """Return JSON values that `load_state_dict` restores exactly, between episodes."""
        return {}

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It is damaged.
        """
