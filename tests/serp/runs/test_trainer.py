"""Algorithm 1: what a step does, and what the learner is given."""

import numpy as np
import pytest

from serp.runs.evaluation import evaluate
from serp.runs.trainer import Trainer
from serp.settings import resolve
from tests.serp.runs.runs import CHANGES, everything, resume, rows, train
from tests.serp.sample_tasks import Corridor, corridor


def begun(task, preset="default", seed=0, **changes):
    """A training with changes of settings, else with those of all runs with the preset."""
    return Trainer(task.bind(), resolve(preset, task.settings, changes or CHANGES[preset]), seed)


def remembered(trainer):
    """What the learner is given to remember: a list that grows."""
    learner = trainer.agent.learner
    seen, remember = [], learner.remember

    def record(*transition):
        seen.append(transition)
        remember(*transition)

    learner.remember = record
    return seen


# What a step does ---------------------------------------------------------------------------------


def test_terminated_and_truncated_reach_the_learner_apart(tmp_path):
    trainer = begun(corridor(tmp_path), "paper")
    seen = remembered(trainer)
    rows = [next(trainer.run()) for _ in range(40)]
    ends = [each[4:6] for each in seen if each[4] or each[5]]
    assert ends == [(row.terminated, row.truncated) for row in rows]
    assert any(row.terminated for row in rows)
    assert any(row.truncated for row in rows)


def test_the_reward_is_the_domains_read_off_the_observed_state(tmp_path):
    """The robot slips: a model that predicts the goal must not pay for it unless it is reached."""
    trainer = begun(corridor(tmp_path), seed=5)
    seen = remembered(trainer)
    rows = [next(trainer.run()) for _ in range(15)]
    for _, action, reward, following, *_ in seen:
        x = following[0]
        step = -0.1 if action < 3 else 0.0  # the domain does not mention the fourth action
        assert reward == pytest.approx(step + (5 if x >= 4 else -5 if x <= -3 else 0))
    assert sum(each[2] for each in seen) == pytest.approx(
        sum(row.domain_return for row in rows if row.domain_return is not None)
    )


class Gusty(Corridor):
    """A gust blows into the pit in the fourth step; the second one did harm that nobody sees."""

    def step(self, action):
        self.x -= 8 * (self.steps == 3)
        return super().step(action)

    def info(self):
        return {**super().info(), "unsafe": np.bool_(self.steps == 2)}


def test_steps_are_unsafe_by_what_was_observed_and_by_what_the_environment_says(tmp_path):
    task = corridor(tmp_path, Gusty)
    trainer = begun(task, "paper")
    rows = [next(trainer.run()) for _ in range(10)]
    assert {(row.length, row.unsafe_observed) for row in rows} >= {(4, 2)}
    assert all(row.unsafe_observed == (row.length > 1) + (row.length == 4) for row in rows)
    assert sum(row.unsafe_executed for row in rows) == 0  # no prediction says so
    found = evaluate(trainer.agent, task.bind(), episodes=5)
    assert found.unsafe_observed == sum((n > 1) + (n == 4) for n in found.lengths)


def test_d0_is_drawn_at_random_then_learned_before_algorithm_1_begins(tmp_path):
    trainer = begun(corridor(tmp_path), "paper")
    learner, arbiter = trainer.agent.learner, trainer.agent.arbiter
    while trainer.env_steps < 25:
        assert learner.updates == 0
        row = next(trainer.run())
        assert row.learner_steps == 0
        assert row.planner_steps == row.vetoes == row.length - row.exploration_steps
        assert row.unsafe_executed == 0
        assert arbiter.strategy.rho == 0.0
    assert learner.updates == trainer.settings.training.random_steps
    row = next(trainer.run())
    assert row.planner_steps == row.length  # rho is 0
    assert arbiter.strategy.rho == 0.05
    assert learner.updates == trainer.settings.training.random_steps + row.length


class Endless(Corridor):
    """Neither ends nor cuts an episode."""

    def step(self, action):
        seen, reward, _, _, info = super().step(action)
        self.x = max(-1, min(1, self.x))
        return seen, reward, False, False, info


def test_an_episode_that_never_ends_is_cut_as_the_settings_say(tmp_path):
    trainer = begun(corridor(tmp_path, Endless), training={"episode_steps": 17})
    seen = remembered(trainer)
    rows = [next(trainer.run()) for _ in range(2)]
    assert [(row.length, row.terminated, row.truncated) for row in rows] == [(17, False, True)] * 2
    assert [each[5] for each in seen] == ([False] * 16 + [True]) * 2
    assert not any(each[4] for each in seen)


def test_rho_of_a_mixture_grows_with_every_episode(tmp_path):
    changes = {"arbiter": {"rho_increment": 0.1}, "guide": {"strategy": "mixture"}}
    trainer = begun(corridor(tmp_path), seed=1, **changes)
    for grown in range(1, 12):
        assert next(trainer.run()).rho == pytest.approx(min(1.0, 0.1 * grown))


def test_callbacks_see_every_step_and_episode_and_change_nothing(tmp_path):
    rewards, seen = [], []
    train(corridor(tmp_path), tmp_path / "alone", episodes=3)
    train(
        corridor(tmp_path), tmp_path / "seen", episodes=3,
        on_step=lambda step: rewards.append(step.env_reward), on_episode=seen.append,
    )  # fmt: skip
    assert everything(tmp_path / "seen") == everything(tmp_path / "alone")
    table = rows(tmp_path / "seen", "metrics")
    assert [str(row.return_) for row in seen] == [row["return"] for row in table]
    assert len(rewards) == seen[-1].env_steps


def test_one_that_fails_ends_the_run_after_the_episode_and_it_goes_on(tmp_path):
    calls = []

    def fails(step):
        calls.append(step.number)
        if len(calls) == 4:
            raise ZeroDivisionError("mine")

    task, out = corridor(tmp_path), tmp_path / "run"
    train(task, tmp_path / "whole", episodes=5)
    with pytest.raises(ZeroDivisionError, match="mine") as failure:
        train(task, out, episodes=5, on_step=fails)
    assert len(calls) == 4
    assert "resume=True" in "".join(failure.value.__notes__)
    assert len(rows(out, "metrics")) == 1
    resume(task, out, episodes=5, on_episode=lambda row: None)
    assert everything(out)[:3] == everything(tmp_path / "whole")[:3]
