"""Compilation of the loops of an agent before training, without an environment.

Without it the robot would pause for seconds after its first observation and at its first update.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Final

import numpy as np

from serp.agent.agent import Agent
from serp.agent.registry import find_learner
from serp.model.learned.adaptation import ModelAdaptation
from serp.model.learned.adapted_model import AdaptedModel
from serp.model.learned.transitions import GOES_ON, OVER

_OBSERVED: Final = 140
"""Number of artificial steps that the adaptation observes: more than 100 use all of it, and more
than 60 of one action use the random features."""
_WHOLE: Final = 10
"""Number of the first of them whose states are whole numbers, so that outcomes are counted."""
_REMEMBERED: Final = 4
"""Number of artificial steps that the learner stores."""
_ROOM: Final = 64


def precompile(agent: Agent) -> None:
    """Compile the loops that an agent calls, with artificial states; the agent does not change."""
    random = np.random.default_rng(0)
    fluents = agent.task.model.fluents
    states = random.normal(size=(_OBSERVED + 1, len(fluents)))
    predicates = [k for k, fluent in enumerate(fluents) if not fluent.numeric]
    states[:, predicates] = states[:, predicates] > 0
    states[: _WHOLE + 1] = np.round(states[: _WHOLE + 1])
    with agent.undisturbed():
        _precompile_learning(agent, states[0])
    if agent.task.model.program.compiled and agent.task.model.actions:
        _precompile_adaptation(agent, states)


def _precompile_adaptation(agent: Agent, states: np.ndarray[Any, np.dtype[np.float64]]) -> None:
    seed = np.random.SeedSequence(0)
    adaptation = ModelAdaptation(agent.task.model, agent.settings.adaptation, seed)
    model = adaptation.model
    if not isinstance(model, AdaptedModel):
        return
    changed = [sum(len(group.targets) for group in groups) for groups in model.feature_groups]
    often = changed.index(max(changed))
    model.precompile(states[0])
    for step, (state, following) in enumerate(pairwise(states)):
        action = often if step % 2 else step // 2 % len(model.actions)
        ending = OVER if step == _OBSERVED - 1 else GOES_ON
        adaptation.observe(state, action, following, ending)


def _precompile_learning(agent: Agent, state: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
    arbiter, strategy, learner = agent.arbiter, agent.strategy, agent.learner
    forecast = arbiter.forecast(state)
    settings = learner.settings.replace(buffer_size=_ROOM, learning_starts=0)
    stand_in = find_learner(settings.name)(
        learner.input_size, learner.action_count, settings, 0, learner.imitates
    )
    stand_in.imitation_weight = strategy.imitation_weight
    x = np.zeros(learner.input_size)
    imitated, allowed = strategy.imitated(forecast), arbiter.vetoes.admissible(forecast)
    for step in range(_REMEMBERED):
        ended = step == _REMEMBERED - 1
        stand_in.remember(x, 0, 0.0, x, ended, False, None if ended else allowed, imitated)
        stand_in.propose_greedily(x)
    if settings.updates_per_step > 0:
        stand_in.pretrain(1)
