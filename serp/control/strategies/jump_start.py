"""Jump-start: the planner acts first in every episode, then the learner (Uchendu et al. 2023)."""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Mapping
from typing import Any, Final

from serp._util.saved_state import Saved
from serp.control.protocols import Proposer
from serp.control.strategies.strategy import Seed, Situation, Strategy
from serp.learning.dqn import Proposal
from serp.settings import Settings

_WINDOW: Final = 5
"""Number of episodes per mean return."""


class JumpStart(Strategy):
    """The planner acts in the first h steps of an episode, then the learner.

    Jump-Start Reinforcement Learning with a curriculum (Uchendu et al. 2023, arXiv 2204.02372): in
    the first five episodes only the planner acts; h begins with the length of the longest of them.
    Whenever the mean return of five episodes is within the tolerance of the best such mean so far,
    h shrinks by a stage. The original uses separate evaluation episodes; here the training episodes
    serve, which cost no samples.
    """

    reads = ("guide.jump_stages", "guide.jump_tolerance")

    def __init__(self, settings: Settings, seed: Seed = 0) -> None:
        super().__init__(settings, seed)
        self._longest = 0
        self._stage = -1
        """-1 while only the planner acts."""
        self._best = -float("inf")
        self._recent: deque[float] = deque(maxlen=_WINDOW)
        self._step = 0

    @property
    def planned_steps(self) -> float:
        """h, the number of steps of an episode in which the planner acts."""
        if self._stage < 0:
            return float("inf")
        return self._longest * (1.0 - self._stage / self._settings.guide.jump_stages)

    @property
    def rho(self) -> float:
        """0 while the planner acts, then 1."""
        return float(self._step >= self.planned_steps)

    @property
    def turns(self) -> str:
        """In words: how long the planner acts."""
        steps = self.planned_steps
        if steps == float("inf"):
            return "the planner's choice"
        if steps <= 0:
            return self.choice
        return f"the planner's choice in the first {math.ceil(steps)} steps, then the learner's"

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return None in the first h steps, then the learner's proposal."""
        planners_turn = self._step < self.planned_steps
        self._step += 1
        return None if planners_turn else learner.propose(situation.admissible)

    def end_episode(self, return_: float, length: int) -> None:
        """Shrink h if the mean return has not dropped."""
        self._step = 0
        if self._stage < 0:
            self._longest = max(self._longest, length)
        self._recent.append(return_)
        if len(self._recent) < _WINDOW or self._stage == self._settings.guide.jump_stages:
            return
        mean = statistics.fmean(self._recent)
        tolerated = self._settings.guide.jump_tolerance * abs(self._best)
        if self._stage < 0 or mean >= self._best - tolerated:
            self._best = max(self._best, mean)
            self._stage += 1
            self._recent.clear()

    def state_dict(self) -> dict[str, Any]:
        """Return JSON values that `load_state_dict` restores exactly, between episodes."""
        return {
            "longest": self._longest,
            "stage": self._stage,
            "best": None if self._stage < 0 else self._best,
            "recent": list(self._recent),
        }

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned."""
        saved = Saved("strategy", {}, meta)
        self._longest = saved.whole("longest")
        self._stage = saved.whole("stage", -1, self._settings.guide.jump_stages)
        self._best = -float("inf") if self._stage < 0 else saved.real("best", -math.inf, math.inf)
        self._recent.clear()
        self._recent.extend(saved.reals("recent", _WINDOW, -math.inf, math.inf, least=0))
        self._step = 0
