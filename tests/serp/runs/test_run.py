"""A run on the disk: what it holds, what it is read back as, and what is refused."""

import json

import numpy as np
import pytest
from gymnasium.wrappers import NormalizeObservation, TimeLimit

from serp.errors import RunError, SettingsError, TaskError
from serp.learning.dqn import DQN
from serp.runs.run import Run, load_run
from serp.runs.train import plan_and_learn
from tests.serp.runs.runs import everything, resume, train
from tests.serp.sample_tasks import SMALL, Corridor, corridor


class Plain(Corridor):
    """Nothing outlives its reset, so nothing of it has to be saved."""

    def reset(self, **options):
        self.clock = 0
        self.weather = np.random.default_rng(5)
        return super().reset(**options)


def test_an_evaluation_sees_what_the_learner_learned_to_see(tmp_path):
    """The grounding undoes the normalisation with nothing but `info`."""
    counts = []

    class Seen(NormalizeObservation):
        def reset(self, **options):
            counts.append(self.obs_rms.count)
            return super().reset(**options)

    def task(wrapper):
        return corridor(
            tmp_path,
            lambda: wrapper(TimeLimit(Plain(), 9)),
            ground=lambda seen: {"x": round(float(seen[0]), 1)},
        )

    run = train(task(NormalizeObservation), tmp_path / "run", episodes=6)
    load_run(run.path, task(Seen)).evaluate(episodes=1)
    steps = run.metrics["env_steps"][-1]
    assert counts == [pytest.approx(steps + 6, abs=1)]  # each reset counts as well


def test_a_run_is_an_option_that_ends_where_its_file_does(tmp_path):
    """It decides as the run does, and what it did before changes nothing."""
    task = corridor(tmp_path, lambda: Corridor(start=10))
    run = train(task, tmp_path / "run", episodes=8)
    option = run.option(steps=6)
    lengths, controls, ended = [], [], False
    for seed in [*range(6), *range(6)]:
        env = Corridor(start=10)
        observation, _ = env.reset(seed=seed)
        running, length = option(observation), 0
        control = next(running)
        try:
            while True:
                assert control == 10 + run.decide(observation).action
                controls.append(control)
                observation, *_ = env.step(control)
                length += 1
                control = running.send(observation)
        except StopIteration:
            over = observation[0] <= -3 or observation[0] >= 4
            assert over or length == 6
            ended = ended or (bool(over) and length < 6)
        lengths.append(length)
    assert ended
    assert lengths[:6] == lengths[6:]
    assert controls[: sum(lengths[:6])] == controls[sum(lengths[:6]) :]
    told = corridor(tmp_path, Plain, ground=lambda seen, info: {"x": seen[0]})
    with pytest.raises(RunError, match="takes info, but an option gets only observations"):
        train(told, tmp_path / "told", episodes=1).option(steps=2)


# What is refused ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "settings", "kind", "said"),
    [
        ({"actions": {"left": 0}}, {}, TaskError, "no environment action"),
        ({}, {"learner": {"buffer_size": 10**13}}, SettingsError, "do not fit into memory"),
        ({}, {"learner": {"hidden": [10**9]}}, SettingsError, "do not fit into memory"),
    ],
)
def test_what_cannot_be_trained_leaves_no_folder(tmp_path, changes, settings, kind, said):
    with pytest.raises(kind, match=said):
        plan_and_learn(
            corridor(tmp_path, **changes), settings=settings, out=tmp_path / "run", quiet=True
        )
    assert not (tmp_path / "run").exists()


def test_a_run_needs_its_own_task(tmp_path):
    train(corridor(tmp_path), tmp_path / "run", episodes=1)
    with pytest.raises(TaskError, match="no task `corridor`"):
        load_run(tmp_path / "run")
    with pytest.raises(RunError, match="a run of task corridor, not of maze"):
        resume(corridor(tmp_path, name="maze"), tmp_path / "run")


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [("domain.pddl", "(reward) 5", "(reward) 6"), ("config.json", '"seed": ', '"seed": 1')],
)
def test_a_run_whose_own_files_were_changed_is_not_continued(tmp_path, name, old, new):
    file = tmp_path / "run" / name
    train(corridor(tmp_path), file.parent, episodes=2)
    before = file.read_text(encoding="utf-8")
    assert old in before
    file.write_text(before.replace(old, new), encoding="utf-8")
    said = f"{name} of the run was changed after the run began"
    with pytest.raises(RunError, match=said):
        resume(corridor(tmp_path), file.parent, episodes=3)
    with pytest.raises(RunError, match=said):
        _ = load_run(file.parent, corridor(tmp_path)).agent


@pytest.mark.parametrize("name", ["metrics.csv", "decisions.csv"])
def test_a_changed_cell_is_noticed_and_what_a_killed_run_wrote_last_is_not_one(tmp_path, name):
    out = tmp_path / "run"
    train(corridor(tmp_path), out, episodes=2)
    data = (out / name).read_bytes()
    at = data.index(b"\n") + 3
    (out / name).write_bytes(data[:at] + b"7" + data[at + 1 :])
    with pytest.raises(RunError, match=rf"{name} is not what the run wrote"):
        resume(corridor(tmp_path), out, episodes=3)
    if name == "metrics.csv":
        with pytest.raises(RunError, match="is not what the run wrote"):
            _ = load_run(out, corridor(tmp_path)).metrics
    (out / name).write_bytes(data + b"3,4")
    assert len(resume(corridor(tmp_path), out, episodes=3).metrics["length"]) == 3


def test_metadata_that_does_not_fit_is_refused(tmp_path):
    train(corridor(tmp_path), tmp_path / "run", episodes=1)
    file = tmp_path / "run" / "config.json"
    about = json.loads(file.read_text())
    wrong = {"seed": 1.5, "control_period": 0, "budget": None, "settings": {"learner": 3}}
    for name, value in wrong.items():
        file.write_text(json.dumps({**about, "config": {**about["config"], name: value}}))
        with pytest.raises(
            RunError, match=r"config\.json was not written .* damaged: .+Restore it"
        ):
            Run(file.parent)


def test_a_run_with_planner_and_learner_of_its_own_resumes_as_if_uninterrupted(tmp_path):
    settings = {"*": {**SMALL, "planner": {"name": "rightwards", "depth": 2}}}
    settings["*"]["learner"] = {**SMALL.get("learner", {}), "name": "mine"}
    own = {"planners": {"rightwards": lambda state: "right"}, "learners": {"mine": DQN}}
    task = corridor(tmp_path, **own, settings=settings)
    run = train(task, tmp_path / "whole", episodes=6)
    assert run.evaluate("planner", episodes=1, quiet=True).returns
    train(task, tmp_path / "half", episodes=3)
    resume(corridor(tmp_path, **own), tmp_path / "half", episodes=6)
    assert everything(tmp_path / "half") == everything(tmp_path / "whole")
