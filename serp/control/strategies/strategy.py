"""The base class of strategies, which decide whether planner or learner proposes."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from serp.control.lead_evidence import LeadEvidence
from serp.control.protocols import Mask, Proposer, Values
from serp.learning.dqn import Proposal
from serp.planning.action_map import ActionForecast

if TYPE_CHECKING:
    from serp.learning.guidance import Guidance, GuidedLearning
    from serp.settings import Settings


Seed = int | np.random.SeedSequence


class Situation(NamedTuple):
    """What a strategy knows of the current state.

    Attributes:
        forecast: The planner's forecast.
        admissible: `[E]` actions that no veto refuses.
    """

    forecast: ActionForecast
    admissible: Mask


class Strategy:
    """A rule for who proposes; in this base class it is always the learner.

    A strategy proposes; `serp.Arbiter` decides, so that the vetoes hold under every strategy. A
    subclass is found by name through the entry-point group `serp.strategies`.

    Args:
        settings: All settings.
        seed: Seed of random draws.

    Attributes:
        reads: Settings that only this strategy reads, such as `guide.margin`.
        guided: How the learner uses the planner's guidance; None for not at all.
    """

    reads: ClassVar[tuple[str, ...]] = ()
    guided: GuidedLearning | None = None

    def __init__(self, settings: Settings, seed: Seed = 0) -> None:
        self._settings = settings

    @property
    def rho(self) -> float:
        """The probability that the learner makes the next proposal."""
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
        """In words: what `propose` returns now, without exploration."""
        return self.choice

    @property
    def evidence(self) -> LeadEvidence | None:
        """The evidence that the choice goes by; None for strategies without any."""
        return None

    @property
    def margin_weight(self) -> float:
        """Weight of the learner's imitation loss in the next updates."""
        return 0.0 if self.guided is None else self.guided.margin_weight

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return the learner's proposal, or None if it is the planner's turn."""
        return learner.propose(situation.admissible)

    def propose_greedily(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return the trained policy's proposal, without exploration or random draws."""
        return learner.propose_greedily()

    def propose_baseline(self, situation: Situation, learner: Proposer) -> Proposal:
        """Return the learner's greedy choice, for execution without planner and veto."""
        return learner.propose_greedily(base=self.base(situation.forecast))

    def forked(self, seed: np.random.SeedSequence) -> Strategy:
        """Return an independent copy for the beginning of an episode.

        Args:
            seed: Seed of the copy's random draws.
        """
        return copy.copy(self)

    def base(self, forecast: ActionForecast) -> Values | None:
        """Return `[E]` values that are added to the network's output; None for zeros."""
        return None

    def allowed(self, forecast: ActionForecast, admissible: Mask) -> Mask:
        """Return `[E]` the actions over which the value of a state is maximised."""
        return admissible

    def guidance(
        self, forecast: ActionForecast, action: int, following: ActionForecast | None
    ) -> Guidance | None:
        """Return the planner's guidance for an env step; None if the learner uses none.

        Args:
            forecast: Forecast for the state before the step.
            action: The executed environment action.
            following: Forecast for the next state; None if the episode ended there.
        """
        return None

    def end_unit(self, unit: str) -> None:
        """Handle the end of a unit: `step`, `episode` or a counter of the environment."""

    def end_episode(self, return_: float, length: int) -> None:
        """Handle the end of an episode of training."""

    def state_dict(self) -> dict[str, Any]:
        """Return JSON values that `load_state_dict` restores exactly, between episodes."""
        return {}

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It is damaged.
        """
