"""A rehearsal without an environment: what acting and learning call is compiled before it begins.

Loops are compiled when they are first called. Without a rehearsal the robot would stand still for
seconds after its first observation, and again where it first learns.
"""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from typing import Final

import numpy as np

from serp.agent import Agent
from serp.correction.correction import Correction
from serp.correction.experience import GOES_ON, OVER
from serp.learning.dqn import DQN
from serp.planning.lookahead import Lookahead

_OBSERVED: Final = 140
"""Made-up steps that the correction observes: with more than a hundred all of it is in use."""
_REMEMBERED: Final = 4
"""Made-up steps that the learner remembers."""
_ROOM: Final = 64


def rehearse(agent: Agent) -> None:
    """Call once what an agent's steps will call, with made-up states; the agent stays as it was.

    Args:
        agent: The agent.
    """
    random = np.random.default_rng(0)
    fluents = agent.task.model.fluents
    states = random.normal(size=(_OBSERVED + 1, len(fluents)))
    predicates = [k for k, fluent in enumerate(fluents) if not fluent.numeric]
    states[:, predicates] = states[:, predicates] > 0
    if isinstance(agent.arbiter.planner, Lookahead):
        _rehearse_learning(agent, states[0])
    if agent.task.model.compiled:
        seed = np.random.SeedSequence(0)
        correction = Correction(agent.task.model, agent.settings.correction, seed)
        actions = max(1, len(agent.task.model.actions))
        for step, (state, following) in enumerate(pairwise(states)):
            ending = OVER if step == _OBSERVED - 1 else GOES_ON
            correction.observe(state, step % actions, following, ending)


def _rehearse_learning(agent: Agent, state: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
    arbiter, learner = agent.arbiter, agent.learner
    forecast = arbiter.forecast(state)
    settings = dataclasses.replace(
        learner.settings,
        buffer_size=max(_ROOM, learner.settings.failing_window),
        protected_early=min(_ROOM, learner.settings.protected_early),
        protected_failing=min(_ROOM, learner.settings.protected_failing),
        learning_starts=0,
    )
    stand_in = DQN(
        learner.input_size, learner.action_count, settings, 0, learner.symmetry, learner.guided
    )
    stand_in.margin_weight = arbiter.strategy.margin_weight
    x = np.zeros(learner.input_size)
    guidance = arbiter.strategy.guidance(forecast, 0, forecast)
    allowed = arbiter.strategy.allowed(forecast, arbiter.admissible(forecast))
    for step in range(_REMEMBERED):
        ended = step == _REMEMBERED - 1
        stand_in.remember(x, 0, 0.0, x, ended, False, None if ended else allowed, ended, guidance)
        stand_in.propose_greedily(x)
    stand_in.member_q(x)
    stand_in.target_q(x)
    if settings.updates_per_step > 0:
        stand_in.pretrain(1)
