"""The mixture: whose turn it is, drawn with ρ."""

from __future__ import annotations

import numpy as np

from serp.agent.strategy import Mixture
from serp.settings import Settings
from tests.serp.agent.scene import learner_acts


def mixture(rho: float) -> Mixture:
    given = {"rho": rho, "rho_increment": 0.25, "rho_unit": "game"}
    return Mixture(Settings().replace({"arbiter": given}))


def test_rho_is_the_learners_share() -> None:
    strategy = mixture(0.3)
    share = np.mean([learner_acts(strategy) for _ in range(5_000)])
    assert abs(share - 0.3) < 4 * np.sqrt(0.3 * 0.7 / 5_000)


def test_rho_grows_by_its_unit_to_one() -> None:
    strategy = mixture(0.1)
    for unit, rho in (("step", 0.1), ("episode", 0.1), ("game", 0.35), ("game", 0.6)):
        strategy.end_unit(unit)
        assert strategy.rho == rho
    strategy.end_unit("game")
    strategy.end_unit("game")
    assert strategy.rho == 1.0
