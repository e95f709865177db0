"""Training under every strategy: what is resumed, who acts, and what is learned from."""

from __future__ import annotations

import contextlib
import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from serp.control.decision import Actor
from serp.control.registry import strategy_names
from serp.control.step_record import StepRecord
from serp.control.strategies.jump_start import JumpStart
from serp.runs.checkpoint import NEWEST, load
from serp.settings import Settings, resolve
from serp.tasks.task import Task
from serp.training.plan_and_learn import plan_and_learn
from serp.training.trainer import Trainer
from tests.serp.sample_tasks import corridor

EPISODES = 15


def changes(strategy: str) -> dict[str, dict[str, Any]]:
    """So that every phase of a strategy is met within a few episodes."""
    return {
        "guide": {
            "strategy": strategy,
            "jump_stages": 3,
            "jump_tolerance": 2.0,
            "imitation_steps": 60,
        },
        "arbiter": {"rho": 0.2, "rho_increment": 0.1, "rho_unit": "episode"},
        "learner": {"epsilon_end": 0.2},
        "training": {"checkpoint_seconds": 1_000.0},
    }


def settings_of(task: Task, strategy: str) -> Settings:
    return resolve("default", task.settings, changes(strategy))


@contextlib.contextmanager
def without_pictures() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("serp._util.figures.render", lambda figure, kind: b"")
        yield


@without_pictures()
def train(folder: Path, out: Path, strategy: str, **options: Any) -> tuple[Any, ...]:
    """Train, and return whatever the run has left behind, but for the time it took."""
    given: Any = {} if options.get("resume") else {"settings": changes(strategy), "seed": 3}
    plan_and_learn(corridor(folder), out=out, quiet=True, **given, **options)
    with open(out / "metrics.csv", newline="") as file:
        rows = [{**row, "wall_time": ""} for row in csv.DictReader(file)]
    arrays, meta = load(out / NEWEST)
    del meta["wall_time"], meta["tables"]
    return (
        rows,
        (out / "decisions.csv").read_bytes(),
        {name: (a.dtype, a.shape, a.tobytes()) for name, a in sorted(arrays.items())},
        json.dumps(meta, sort_keys=True),
    )


@pytest.mark.parametrize("strategy", strategy_names())
def test_resume_equals_uninterrupted(tmp_path: Path, strategy: str) -> None:
    whole = train(tmp_path, tmp_path / "whole", strategy, episodes=EPISODES)
    train(tmp_path, tmp_path / "run", strategy, episodes=3)
    for episodes in (10, EPISODES):
        resumed = train(tmp_path, tmp_path / "run", strategy, episodes=episodes, resume=True)
    assert resumed == whole


def steps_of(folder: Path, strategy: str, episodes: int) -> tuple[Trainer, list[StepRecord]]:
    task = corridor(folder)
    trainer = Trainer(task.bind(), settings_of(task, strategy), 1)
    made: list[StepRecord] = []
    trainer.on_step = made.append
    for _ in range(episodes):
        trainer.run_episode()
    return trainer, made


def test_jump_start_begins_every_episode_with_the_planner(tmp_path: Path) -> None:
    task = corridor(tmp_path)
    trainer = Trainer(task.bind(), settings_of(task, "jump-start"), 1)
    made: list[StepRecord] = []
    trainer.on_step = made.append
    strategy = trainer.agent.arbiter.strategy
    assert isinstance(strategy, JumpStart)
    seen = []
    for _ in range(45):
        h = strategy.planned_steps
        seen.append(h)
        made.clear()
        trainer.run_episode()
        for step, transition in enumerate(made):
            assert (transition.decision.proposed_by is Actor.PLANNER) == (step < h)
    assert seen == sorted(seen, reverse=True)
    assert seen[-1] == 0


def test_dqfd_demonstrates_first_and_imitates_nothing_else(tmp_path: Path) -> None:
    trainer, made = steps_of(tmp_path, "dqfd", 20)
    # The decision on step 60 falls before the step before it is counted.
    assert all(t.decision.proposed_by is Actor.PLANNER for t in made[:60])
    assert not any(t.decision.proposed_by is Actor.PLANNER for t in made[61:])
    assert len(made) > 100
    guided = trainer.agent.learner.guided
    assert guided is not None
    assert guided.margin_weight == trainer.agent.learner.margin_weight == 1.0


def test_imitation_is_switched_off_in_the_learner_after_its_end(tmp_path: Path) -> None:
    task = corridor(tmp_path)
    trainer = Trainer(task.bind(), settings_of(task, "imitate-then-learn"), 1)
    weights: list[tuple[float, bool]] = []
    trainer.on_step = lambda transition: weights.append(
        (trainer.agent.learner.margin_weight, transition.decision.proposed_by is Actor.PLANNER)
    )
    for _ in range(20):
        trainer.run_episode()
    end = [weight for weight, _ in weights].index(0.0)
    assert 30 <= end <= 60
    assert [weight for weight, _ in weights] == [1.0] * end + [0.0] * (len(weights) - end)
    assert any(planned for _, planned in weights[:end])
    assert not any(planned for _, planned in weights[end + 1 :])


def test_restrict_executes_what_has_a_good_enough_plan(tmp_path: Path) -> None:
    _, made = steps_of(tmp_path, "restrict", 25)
    checked = 0
    for transition in made:
        decision = transition.decision
        values = decision.forecast.value
        if not decision.admissible.any():
            continue
        best = values[decision.admissible].max()
        assert values[decision.action] >= best - 0.2 * abs(best)
        checked += 1
    assert checked > 100
    assert any(t.decision.proposed_by is Actor.EXPLORATION for t in made)


def test_an_untrained_residual_learner_is_the_planner_and_the_learner_alone_too(
    tmp_path: Path,
) -> None:
    task = corridor(tmp_path)
    trainer = Trainer(task.bind(), settings_of(task, "residual"), 1)
    agent = trainer.agent
    for x in range(-2, 4):
        state, seen = agent.perceive(np.array([x, 0.3]))
        planned = agent.arbiter.plan(state)
        assert agent.decide_greedily(state, seen).action == planned.action
        alone = agent.decide_as_baseline(state, seen)
        value = planned.forecast.value
        assert value[alone.action] == value[task.bind().actions.modelled].max()


@pytest.mark.parametrize("strategy", strategy_names())
def test_every_strategy_learns_and_its_learner_is_asked_in_the_end(
    tmp_path: Path, strategy: str
) -> None:
    trainer, made = steps_of(tmp_path, strategy, 45)
    assert trainer.agent.learner.updates > 100
    late = {t.decision.proposed_by for t in made[-100:]}
    assert late & {Actor.LEARNER, Actor.EXPLORATION}
    assert np.isfinite(trainer.agent.learner.q_values(np.zeros(3))).all()
