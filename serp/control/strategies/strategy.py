"""The base class of strategies, which decide whether planner or learner proposes."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from serp.control.lead_evidence import LeadEvidence
from serp.control.protocols import Mask, Proposer
from serp.learning.dqn import Proposal
from serp.planning.action_map import ActionForecast

if TYPE_CHECKING:
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
        reads: Settings that only this strategy reads, such as `arbiter.rho_unit`.
        imitates: Whether the learner imitates the planner: the action `imitated`, with the weight
            `imitation_weight`.
        chooses_planner: Whether it chooses among several planners (`planner.name` is `a+b`).
        lane: Environment, from 0, that the next calls are about. Several environments play one
            episode each at the same time; what belongs to an episode is kept for each of them.
    """

    reads: ClassVar[tuple[str, ...]] = ()
    imitates: ClassVar[bool] = False
    chooses_planner: ClassVar[bool] = False

    def __init__(self, settings: Settings, seed: Seed = 0) -> None:
        self._settings = settings
        self.lane = 0

    @property
    def rho(self) -> float:
        """The probability that the learner makes the next proposal."""
        return 1.0

    @property
    def planner(self) -> int:
        """Position of the planner that acts in this episode of training."""
        return 0

    @property
    def best_planner(self) -> int:
        """Position of the planner that is best by what is known."""
        return 0

    @property
    def choice(self) -> str:
        """In words: what `propose_greedily` returns."""
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
    def imitation_weight(self) -> float:
        """Weight of the learner's imitation loss in the next updates."""
        return 0.0

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return the learner's proposal, or None if it is the planner's turn."""
        return learner.propose(situation.admissible)

    def propose_greedily(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return the trained policy's proposal, without exploration or random draws."""
        return learner.propose_greedily()

    def forked(self, seed: np.random.SeedSequence) -> Strategy:
        """Return an independent copy for the beginning of an episode.

        Args:
            seed: Seed of the copy's random draws.
        """
        return copy.copy(self)

    def imitated(self, forecast: ActionForecast) -> int:
        """Return the planner's action that the learner is to imitate in a state; -1: none."""
        return -1

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
