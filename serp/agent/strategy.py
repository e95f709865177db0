"""What decides whether planner or learner proposes: the base class, and the strategy `mixture`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from serp._util.saved_state import Declared, Reader, probability, random
from serp._util.text import measured, percent, plural
from serp.agent.decision import Decision
from serp.agent.protocols import Mask, Proposer
from serp.agent.step_record import StepRecord
from serp.learning.dqn import Proposal
from serp.model.transition_model import Vector
from serp.settings import Settings
from serp.tasks.action_map import ActionForecast


class Worth(NamedTuple):
    """Mean and standard deviation of what an acting policy's return is believed to be."""

    mean: float
    deviation: float
    episodes: int

    def __str__(self) -> str:
        return measured(self.mean, self.deviation)


class PolicyEvidence(NamedTuple):
    """The evidence by which planner or learner becomes the acting policy of an episode.

    Attributes:
        planner, learner: What their episodes are worth; None for one without any.
        learner_better: Probability that the learner's are worth more.
    """

    planner: Worth | None
    learner: Worth | None
    learner_better: float

    def as_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        return {
            "planner": None if self.planner is None else self.planner._asdict(),
            "learner": None if self.learner is None else self.learner._asdict(),
            "learner_better": self.learner_better,
            "sentence": str(self),
        }

    def __str__(self) -> str:
        parts = []
        for name, worth in (("planner", self.planner), ("learner", self.learner)):
            if worth is None:
                parts.append(f"no episode led by the {name}")
            else:
                led = plural(worth.episodes, "episode")
                parts.append(f"mean return {worth} in {led} led by the {name}")
        better = percent(self.learner_better)
        return "; ".join([*parts, f"the learner is better with probability {better}"])


Seed = int | np.random.SeedSequence


class Lesson(NamedTuple):
    """What the learner is to learn from an env step.

    Attributes:
        reward: The reward.
        imitated: The planner's action, to be imitated before the step; -1: none.
        allowed: `[E]` actions whose values count after the step; None: all.
    """

    reward: float
    imitated: int = -1
    allowed: Mask | None = None


class Situation:
    """What is known of the current state; the planner plans when its forecast is asked for.

    `state` and `admissible` are kept as given.

    Args:
        state: The monitored state `[F]`.
        known: The planner's forecast, or one that says only which actions are safe.
        admissible: `[E]` what no veto refuses.
        plan: Returns the planner's forecast; None where `known` is that.

    Attributes:
        known: The planner's forecast once it has planned.
    """

    def __init__(
        self,
        state: Vector,
        known: ActionForecast,
        admissible: Mask,
        plan: Callable[[], ActionForecast] | None = None,
    ) -> None:
        self.state = state
        self.known, self.admissible, self._plan = known, admissible, plan

    @property
    def forecast(self) -> ActionForecast:
        """The planner's forecast."""
        if self._plan is not None:
            self.known, self._plan = self._plan(), None
        return self.known

    @property
    def record(self) -> tuple[ActionForecast, Mask]:
        """The last two fields of a `Decision`."""
        return self.known, self.admissible


class Strategy(Declared):
    """The learner always proposes.

    This is the base class of all strategies. A strategy proposes; `serp.Arbiter` decides, so that
    the vetoes hold under every strategy. A subclass is found by name through the entry-point group
    `serp.strategies`.

    Args:
        settings: All settings.
        seed: Seed of random draws.

    Attributes:
        imitates: Whether the learner imitates the planner: the action `imitated` of its lessons,
            with the weight `imitation_weight`.
        env_index: Environment, from 0, that the next calls are about. Several environments play one
            episode each at the same time; what belongs to an episode is kept for each of them.
    """

    imitates: ClassVar[bool] = False

    def __init__(self, settings: Settings, seed: Seed = 0) -> None:
        self._settings = settings
        self._random = np.random.default_rng(seed)
        self.env_index = 0

    @property
    def rho(self) -> float:
        """The probability that the learner makes the next proposal; NaN if none is drawn."""
        return 1.0

    @property
    def choice(self) -> str:
        """In words: what `propose_greedily` returns."""
        return "the learner's choice"

    @property
    def evidence(self) -> PolicyEvidence | None:
        """The evidence that the choice goes by; None for strategies without any."""
        return None

    @property
    def imitation_weight(self) -> float:
        """Weight of the learner's imitation loss in the next updates."""
        return 0.0

    def needs_plan(self, *, greedily: bool = False) -> bool:
        """Return whether the next proposal is likely to depend on the planner's forecast.

        Where it is not, only the safety of actions is computed before the forecast is asked for.
        """
        return False

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return the learner's proposal, or None if it is the planner's turn."""
        return learner.propose(situation.admissible)

    def propose_greedily(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return the trained policy's proposal, without exploration or random draws."""
        return learner.propose_greedily()

    def lesson(self, step: StepRecord, following: Decision | None) -> Lesson:
        """Return what the learner is to learn from a step of training.

        `following` is the decision after it in its episode; None where the episode ended.
        """
        return Lesson(step.reward, -1, None if following is None else following.admissible)

    def end_episode(self, return_: float, length: int) -> None:
        """Handle the end of an episode of training."""


class Mixture(Strategy):
    """The planner acts with probability 1 - ρ, else the learner (paper, Algorithm 1).

    The learner explores among all actions; its proposals may be refused.
    """

    STATE: ClassVar[Mapping[str, Reader]] = {"_rho": probability, "_random": random}

    def __init__(self, settings: Settings, seed: Seed = 0) -> None:
        super().__init__(settings, seed)
        self._rho = settings.arbiter.rho

    @property
    def rho(self) -> float:
        """ρ."""
        return self._rho

    def needs_plan(self, *, greedily: bool = False) -> bool:
        """Return whether it is more likely the planner's turn."""
        return self._rho < 0.5 and not greedily

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Draw whose turn it is; return the learner's proposal, or None."""
        return None if self._random.random() > self._rho else learner.propose(None)

    def end_episode(self, return_: float, length: int) -> None:
        """Increase ρ."""
        self._rho = min(1.0, self._rho + self._settings.arbiter.rho_increment)
