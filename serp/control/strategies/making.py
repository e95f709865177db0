"""From settings to a strategy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from serp._util.text import did_you_mean
from serp.control.strategies.argmax_q import ArgmaxQ
from serp.control.strategies.dqfd import Demonstrations
from serp.control.strategies.imitate import ImitateThenLearn
from serp.control.strategies.jump_start import JumpStart
from serp.control.strategies.mixture import mixture_of
from serp.control.strategies.residual import Residual
from serp.control.strategies.restrict import Restrict
from serp.control.strategies.strategy import Strategy
from serp.errors import SettingsError
from serp.settings import Settings

_Seed = int | np.random.SeedSequence

STRATEGIES: Final[Mapping[str, Callable[[Settings, _Seed], Strategy]]] = {
    "mixture": lambda settings, seed: mixture_of(settings.arbiter, seed),
    "jump-start": lambda settings, seed: JumpStart(
        stages=settings.guide.jump_stages, tolerance=settings.guide.jump_tolerance
    ),
    "argmax-q": lambda settings, seed: ArgmaxQ(scale=settings.learner.reward_scale),
    "restrict": lambda settings, seed: Restrict(slack=settings.guide.restrict_slack),
    "imitate-then-learn": lambda settings, seed: ImitateThenLearn(
        steps=settings.guide.imitation_steps, margin=settings.guide.margin, seed=seed
    ),
    "residual": lambda settings, seed: Residual(scale=settings.learner.reward_scale),
    "dqfd": lambda settings, seed: Demonstrations(
        steps=settings.guide.imitation_steps, margin=settings.guide.margin
    ),
}
"""Name → what makes the strategy from all settings and the seed of its draws."""


def make_strategy(settings: Settings, seed: _Seed) -> Strategy:
    """Return the strategy that `guide.strategy` names.

    Raises:
        SettingsError: There is no such strategy.
    """
    name = settings.guide.strategy
    if name not in STRATEGIES:
        raise SettingsError(
            f"guide: there is no strategy `{name}`; {did_you_mean(name, STRATEGIES)}"
        )
    return STRATEGIES[name](settings, seed)
