"""From settings to a strategy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from serp.control.strategies.argmax_q import ArgmaxQ
from serp.control.strategies.dqfd import Demonstrations
from serp.control.strategies.imitate import ImitateThenLearn
from serp.control.strategies.jump_start import JumpStart
from serp.control.strategies.residual import Residual
from serp.control.strategies.restrict import Restrict
from serp.control.strategies.strategy import Strategy

if TYPE_CHECKING:
    from serp.settings import Settings


def make_strategy(settings: Settings, seed: int | np.random.SeedSequence) -> Strategy:
    """Return the strategy that `guide.strategy` names.

    Args:
        settings: All settings.
        seed: Seed of its draws.
    """
    guide, scale = settings.guide, settings.learner.reward_scale
    match guide.strategy:
        case "jump-start":
            return JumpStart(stages=guide.jump_stages, tolerance=guide.jump_tolerance)
        case "argmax-q":
            return ArgmaxQ(scale=scale)
        case "restrict":
            return Restrict(slack=guide.restrict_slack)
        case "imitate-then-learn":
            return ImitateThenLearn(steps=guide.imitation_steps, margin=guide.margin, seed=seed)
        case "residual":
            return Residual(scale=scale)
        case "dqfd":
            return Demonstrations(steps=guide.imitation_steps, margin=guide.margin)
        case "mixture":
            return settings.arbiter.mixture(seed)
