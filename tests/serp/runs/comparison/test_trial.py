"""A trial is a run: made by the training loop, opened as a run, and continued as one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import serp
from serp.agent.agent import Agent
from serp.errors import Interrupted, RunError
from serp.runs.comparison.trial import (
    ExternalEnv,
    file_name,
    read_evaluations,
    read_trial,
    run_trial,
)
from serp.runs.trainer import Trainer
from tests.serp.runs.comparison.contest import PROTOCOL, Walk, found_in, job, walk


class Killed(BaseException):
    """The process is killed."""


def killed_after(steps):
    """An environment whose process is killed after so many steps in all."""

    class Mortal(Walk):
        left = steps

        def step(self, action):
            type(self).left -= 1
            if type(self).left < 0:
                raise Killed
            return super().step(action)

    return Mortal


def test_evaluations_change_nothing_and_a_trial_is_the_run_of_the_same_settings(tmp_path):
    task = walk(tmp_path)
    run_trial(job(task, "serp", tmp_path / "trial"))
    serp.plan_and_learn(task, env_steps=PROTOCOL.env_steps, out=tmp_path / "run", quiet=True)
    (tmp_path / "run" / "evaluations.csv").write_text("")
    trial, run = found_in(tmp_path / "trial"), found_in(tmp_path / "run")
    assert (trial[0], trial[2]) == (run[0], run[2])


@pytest.mark.parametrize(
    ("algorithm", "policies"),
    [("serp", ["learner", "policy"]), ("mrp", ["policy"]), ("dqn", ["learner"])],
)
def test_it_is_evaluated_at_fixed_points_and_opened_as_a_run(tmp_path, algorithm, policies):
    todo = job(walk(tmp_path), algorithm, tmp_path / "trial")
    assert not todo.complete
    run_trial(todo)
    assert todo.complete
    table = read_evaluations(todo.folder)
    keys = list(zip(table["env_steps"], table["policy"], table["episode"], strict=True))
    points = [] if algorithm == "mrp" else [50, 100]
    assert keys == [
        *((at, "learner", n) for at in points for n in (1, 2, 3)),
        *((130, policy, n) for policy in policies for n in (1, 2, 3, 4)),
    ]
    assert ((table["outcome"] != "") == (table["terminated"] == 1)).all()
    assert (table["info.slips"] <= table["length"]).all()
    assert np.isnan(table["unsafe"][table["env_steps"] < 130]).all()
    assert read_trial(todo).episodes["env_steps"].max() <= 130
    run = serp.load_run(todo.folder, walk(tmp_path))
    assert len(run.evaluate(episodes=3, quiet=True).returns) == 3
    if algorithm == "dqn":  # the learner always acts, and nothing is refused
        assert not run.agent.arbiter.vetoes.refuses
        assert run.metrics["planner_steps"].sum() == run.metrics["vetoes"].sum() == 0


@pytest.mark.parametrize("algorithm", ["serp", "dqn"])
def test_one_that_was_killed_or_stopped_and_goes_on_equals_an_uninterrupted_one(
    tmp_path, algorithm
):
    whole = job(walk(tmp_path), algorithm, tmp_path / "whole")
    run_trial(whole)
    for steps in (3, 30, 75):  # in the first episode, in training, in an evaluation
        mortal = walk(tmp_path, killed_after(steps))
        with pytest.raises(Killed):
            run_trial(job(mortal, algorithm, tmp_path / "parts"))
    parts = job(walk(tmp_path), algorithm, tmp_path / "parts")
    before = len(found_in(parts.folder)[0])
    with pytest.raises(Interrupted):
        run_trial(parts, lambda: True)
    assert 0 < len(found_in(parts.folder)[0]) == before + 1
    assert not parts.complete
    run_trial(parts)
    assert found_in(parts.folder) == found_in(whole.folder)


def test_a_run_that_went_on_without_its_evaluations_or_of_other_settings_is_refused(tmp_path):
    task, folder = walk(tmp_path), tmp_path / "trial"
    todo = job(task, "serp", folder)
    serp.plan_and_learn(task, env_steps=60, out=folder, quiet=True)
    with pytest.raises(RunError, match="ran without the evaluations of this comparison"):
        run_trial(todo)
    with pytest.raises(RunError, match="different settings"):
        run_trial(job(walk(tmp_path), "dqn", folder))
    with pytest.raises(RunError, match="different seeds"):
        run_trial(job(walk(tmp_path), "serp", folder, seed=1))


@given(st.text(min_size=1, max_size=200))
def test_names_of_folders_are_valid_and_differ(name):
    file = file_name(name)
    assert file not in ("", ".", "..") and len(file.encode()) <= 120 and "/" not in file
    assert file == file_name(name) and file != file_name(name + "x")


# External algorithms ------------------------------------------------------------------------------


def test_an_external_one_writes_a_run_folder_with_the_budget(tmp_path, external):
    todo = job(walk(tmp_path), "drawing", tmp_path / "drawing")
    with pytest.raises(Interrupted):
        run_trial(todo, lambda: True)
    assert not todo.complete
    run_trial(todo)  # from the beginning
    assert todo.complete
    record = read_trial(todo)
    assert 118 < record.episodes["env_steps"][-1] <= 130
    assert len((todo.folder / "decisions.csv").read_text().splitlines()) == 131
    assert set(record.evaluations["policy"]) == {"learner"}


def test_a_masked_one_is_evaluated_within_the_masks(tmp_path, external):
    todo = job(walk(tmp_path), "masked", tmp_path / "masked")
    run_trial(todo)
    assert not read_trial(todo).evaluations["terminated"].any()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("lazy", "`lazy` ended after 120 of 130 env steps"),
        ("faulty", "`faulty` failed: ValueError: expected scalar type"),
    ],
)
def test_one_that_fails_is_named(tmp_path, external, name, message):
    todo = job(walk(tmp_path), name, tmp_path / name)
    with pytest.raises(RunError, match=message):
        run_trial(todo)
    assert not todo.complete


@pytest.mark.parametrize("reward", ["domain", "environment"])
def test_an_external_one_meets_what_our_learner_meets(tmp_path, reward):
    """With the actions that our learner took: the same seeds, observations, rewards and ends."""
    task = walk(tmp_path, reward=reward)
    settings = job(task, "dqn", tmp_path).settings
    ours = []
    with task.bind() as bound, Trainer(bound, settings, 5, baseline=True) as trainer:
        trainer.on_step = ours.append
        while trainer.env_steps < 150:
            next(trainer.run())
    theirs = []
    with task.bind() as bound:
        env = ExternalEnv(bound, Agent(bound, settings, 5), 5, theirs.append)
        x, _ = env.reset(seed=123)  # a seed of its own would not be the same protocol
        for step in ours:
            assert (x == step.x.astype(np.float32)).all()
            x, *outcome, _ = env.step(np.int64(step.decision.action))
            assert outcome == [step.reward, step.terminated, step.truncated]
            if step.last:
                x, _ = env.reset()
    assert any(step.decision.unsafe for step in theirs)
    for one, other in zip(ours, theirs, strict=True):
        assert other.decision.unsafe == one.decision.unsafe and not other.decision.vetoed
