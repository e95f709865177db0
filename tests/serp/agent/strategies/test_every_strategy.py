"""What ρ says under every strategy, and how that of the mixture grows."""

from random import Random

import numpy as np
import pytest

from serp.agent.registry import find_strategy
from serp.settings import resolve
from tests.serp.agent.scene import learner_acts


def made(strategy, seed=0, **arbiter):
    given = {"rho": 0.2, "rho_increment": 0.1, **arbiter}
    changes = {"guide": {"strategy": strategy}, "arbiter": given}
    return find_strategy(strategy)(resolve("default", None, changes), seed)


@pytest.mark.parametrize("name", ["evidence", "mixture"])
def test_rho_is_the_probability_that_the_learner_acts(name):
    for seed in range(20):
        strategy, random = made(name, seed), Random(seed)
        for _ in range(60):
            length = random.randint(1, 12)
            for _ in range(length):
                rho, acts = strategy.rho, learner_acts(strategy)
                assert 0.0 <= rho <= 1.0
                assert rho not in (0.0, 1.0) or acts == bool(rho)  # else it is drawn
            strategy.end_episode(random.gauss(0.0, 1.0), length)
        # By evidence the learner need not be the better one in the end.
        assert strategy.rho == 1.0 or name == "evidence"


def test_rho_is_the_learners_share_of_a_mixture():
    strategy = made("mixture", rho=0.3)
    share = np.mean([learner_acts(strategy) for _ in range(5_000)])
    assert abs(share - 0.3) < 4 * np.sqrt(0.3 * 0.7 / 5_000)
