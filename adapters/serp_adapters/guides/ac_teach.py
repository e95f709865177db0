"""AC-Teach: an ensemble of teachers, and whoever the critic believes in acts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np

from serp._util.saved_state import Reader, random
from serp.agent.protocols import Proposer
from serp.agent.strategy import Seed, Situation, Strategy
from serp.learning.dqn import Proposal
from serp.settings import Settings

_COMMITMENT: Final = 0.6
"""Right after a choice, another policy takes over if it is better with this probability."""
_DECAY: Final = 0.99
"""Factor of that probability for every further step of the same policy."""

LEARNER: Final = 3
"""Number of the learner among the policies."""


def teachers(situation: Situation) -> list[int]:
    """Return what the three teachers would do; -1 where one has nothing to say.

    All of them are partial: the planner sees its whole plan, the greedy one the next reward, the
    cautious one how long it is possible to stay safe.
    """
    forecast, allowed = situation.forecast, situation.admissible
    if not allowed.any():
        return [-1, -1, -1]
    greedy = int(np.where(allowed, forecast.reward, -np.inf).argmax())
    longest = forecast.safe_steps == forecast.safe_steps[allowed].max()
    cautious = int(np.where(allowed & longest, forecast.path_risk, np.inf).argmin())
    return [forecast.choice, greedy, cautious]


class AcTeach(Strategy):
    """The critic chooses among the planner, two simple teachers and the learner (AC-Teach).

    Kurenkov, Mandlekar, Martin-Martin, Savarese and Garg 2019, "AC-Teach: a Bayesian actor-critic
    method for policy learning with an ensemble of suboptimal teachers", CoRL, arXiv 1909.04121.
    Thompson sampling over the critic's posterior chooses the policy whose action has the largest
    value, and stays with it until another is better with a probability that falls with time. There
    an actor-critic in continuous actions has its posterior from dropout; here a DQN has it from its
    ensemble (Osband et al. 2016, arXiv 1602.04621), so that `learner.members` should be 3 or more.
    The trained policy is the learner's.
    """

    rho = math.nan  # whose turn it is depends on the values
    STATE: ClassVar[Mapping[str, Reader]] = {"_random": random}

    def __init__(self, settings: Settings, seed: Seed = 0) -> None:
        super().__init__(settings, seed)
        count = settings.training.num_envs
        self._acting = [-1] * count
        """Environment → the policy that acts, -1 at the beginning of an episode."""
        self._since = [0] * count

    def needs_plan(self, *, greedily: bool = False) -> bool:
        """Return whether the teachers are asked."""
        return not greedily

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Choose a policy by Thompson sampling, with commitment; return what it proposes."""
        explored = learner.propose(situation.admissible)
        proposed = np.array([*teachers(situation), explored.action])
        values = np.where(proposed < 0, -np.inf, learner.values()[:, proposed])
        drawn = values[self._random.integers(len(values))]
        policy, acting = int(drawn.argmax()), self._acting[self.env_index]
        since = self._since[self.env_index]
        stays = acting >= 0 and proposed[acting] >= 0 and policy != acting
        if stays and (values[:, policy] > values[:, acting]).mean() < _COMMITMENT * _DECAY**since:
            policy = acting
        self._since[self.env_index] = since + 1 if policy == acting else 0
        self._acting[self.env_index] = policy
        if policy == LEARNER:
            return explored
        return Proposal(int(proposed[policy]), False) if policy else None

    def end_episode(self, return_: float, length: int) -> None:
        """End the commitment."""
        self._acting[self.env_index], self._since[self.env_index] = -1, 0
