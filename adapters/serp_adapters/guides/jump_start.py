"""Jump-start: the planner begins every episode, the learner ends it."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping
from typing import Any, ClassVar, Final

from serp._util.saved_state import LARGEST, Reader, Saved, count, within
from serp.agent.protocols import Proposer
from serp.agent.strategy import Seed, Situation, Strategy
from serp.learning.dqn import Proposal
from serp.settings import Settings

STAGES: Final = 10
"""Stages in which the planner's part goes to 0."""
_WINDOW: Final = 5
"""Episodes that a mean is taken over."""
_TOLERANCE: Final = 0.05
"""How much worse than the best mean a mean may be, as a share of its size."""


class JumpStart(Strategy):
    """The planner begins every episode, the learner ends it and takes over step by step (JSRL).

    Uchendu et al. 2023, "Jump-start reinforcement learning", ICML, arXiv 2204.02372, with its
    curriculum: in the first five episodes the planner acts alone; the longest of them gives h,
    their mean return the mark. Whenever the mean return of five episodes is at least nearly the
    best such mean so far, h shrinks by a stage. The original evaluates the policy for that apart;
    here the episodes of the training count, which costs no samples.
    """

    rho = math.nan  # whose turn it is depends on the step of the episode
    STATE: ClassVar[Mapping[str, Reader]] = {
        "_longest": count,
        "_stage": within(-1, STAGES),
        "_best": within(-LARGEST),
    }

    def __init__(self, settings: Settings, seed: Seed = 0) -> None:
        super().__init__(settings, seed)
        self._longest, self._best = 0, 0.0
        self._stage = -1  # the planner acts alone
        self._recent: list[float] = []
        self._steps = [0] * settings.training.num_envs

    @property
    def planned_steps(self) -> float:
        """h: so many steps of an episode are the planner's."""
        return float("inf") if self._stage < 0 else self._longest * (1.0 - self._stage / STAGES)

    @property
    def _planners_turn(self) -> bool:
        return self._steps[self.env_index] < self.planned_steps

    def needs_plan(self, *, greedily: bool = False) -> bool:
        """Return whether it is the planner's turn."""
        return self._planners_turn and not greedily

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return None in the first h steps."""
        planners_turn = self._planners_turn
        self._steps[self.env_index] += 1
        return None if planners_turn else learner.propose(situation.admissible)

    def end_episode(self, return_: float, length: int) -> None:
        """Shrink h where the returns have held."""
        self._steps[self.env_index] = 0
        if self._stage < 0:
            self._longest = max(self._longest, length)
        self._recent = [*self._recent, return_][-_WINDOW:]
        if len(self._recent) < _WINDOW or self._stage == STAGES:
            return
        mean = statistics.fmean(self._recent)
        if self._stage < 0 or mean >= self._best - _TOLERANCE * abs(self._best):
            self._best = mean if self._stage < 0 else max(self._best, mean)
            self._stage += 1
            self._recent = []

    def state_dict(self) -> dict[str, Any]:
        """Return JSON values that `load_state_dict` restores exactly, between episodes."""
        return {**super().state_dict(), "recent": list(self._recent)}

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned, or raise a RunError if it is damaged."""
        saved = Saved(type(self).__name__, {}, meta)
        found = meta.get("recent")
        recent = saved.reals("recent", min(len(found), _WINDOW) if isinstance(found, list) else 0)
        super().load_state_dict(meta)
        self._stage, self._recent = int(self._stage), recent
