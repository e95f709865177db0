"""What holds under every strategy: what ρ says, what is resumed, and what is learned from."""

from __future__ import annotations

from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

from serp.agent.decision import Actor
from serp.agent.registry import find_strategy
from serp.agent.step_record import StepRecord
from serp.agent.strategy import Strategy
from serp.runs.trainer import Trainer
from serp.settings import resolve
from tests.serp.agent.scene import learner_acts
from tests.serp.sample_tasks import corridor

EPISODES = 15


def changes(strategy: str) -> dict[str, dict[str, Any]]:
    """So that every phase of a strategy is met within a few episodes."""
    return {
        "guide": {"strategy": strategy},
        "arbiter": {"rho": 0.2, "rho_increment": 0.1, "rho_unit": "episode"},
        "learner": {"epsilon_end": 0.2},
    }


def made(strategy: str, seed: int = 0) -> Strategy:
    return find_strategy(strategy)(resolve("default", None, changes(strategy)), seed)


def episode(strategy: Strategy, random: Random) -> list[bool]:
    """Play an episode; return for every step whether the learner acted."""
    acted = []
    length = random.randint(1, 12)
    for _ in range(length):
        rho = strategy.rho
        acted.append(learner_acts(strategy))
        if rho in (0.0, 1.0):  # else it is drawn
            assert acted[-1] == bool(rho)
        assert 0.0 <= rho <= 1.0
        strategy.end_unit("step")
    strategy.end_episode(random.gauss(0.0, 1.0), length)
    strategy.end_unit("episode")
    return acted


@pytest.mark.parametrize("name", ["evidence", "mixture"])
def test_rho_is_the_probability_that_the_learner_acts(name: str) -> None:
    for seed in range(20):
        strategy, random = made(name, seed), Random(seed)
        played = [episode(strategy, random) for _ in range(60)]
        # By evidence the learner need not be the better one in the end.
        assert all(played[-1]) or name == "evidence"


@pytest.mark.parametrize("strategy", ["evidence", "mixture"])
def test_the_learner_learns_is_asked_in_the_end_and_imitates_as_the_strategy_says(
    tmp_path: Path, strategy: str
) -> None:
    task = corridor(tmp_path)
    trainer = Trainer(task.bind(), resolve("default", task.settings, changes(strategy)), 1)
    learner, steps = trainer.agent.learner, list[StepRecord]()
    trainer.on_step = steps.append
    for _ in range(45):
        trainer.run_episode()
    assert learner.updates > 100
    trainer.agent.learn()  # with what the strategy says after the last episode
    assert learner.imitation_weight == trainer.agent.strategy.imitation_weight
    assert np.isfinite(learner.q_values(np.zeros(3))).all()
    late = {step.decision.proposed_by for step in steps[-100:]}
    assert late & {Actor.LEARNER, Actor.EXPLORATION} or strategy == "evidence"
