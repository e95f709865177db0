"""Runs on the disk: whatever stops one, continuing it gives what an undisturbed one gives."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

from serp.errors import EnvironmentFailure, RunError, SettingsError, TaskError
from serp.run import Interrupted, Run, load_run, plan_and_learn
from serp.runs.checkpoint import DAMAGED, NEWEST, PREVIOUS, load
from serp.task import Task
from tests.serp.tasks import CableCut, Corridor, corridor

EPISODES = 12
PRESETS = ("paper", "default")
CHANGES: dict[str, dict[str, dict[str, Any]]] = {
    "paper": {"training": {"random_steps": 25}, "arbiter": {"rho_increment": 0.05}},
    "default": {
        "arbiter": {"rho_unit": "game", "rho_increment": 0.1, "r_min": -1.0},
        "learner": {"updates_per_step": 0.7},
    },
}


@contextlib.contextmanager
def without_pictures() -> Iterator[None]:
    """Drawing takes longer than all the training here; one test does draw."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("serp.runs.plots.render", lambda figure, kind: b"")
        yield


@without_pictures()
def train(task: Task, out: Path, preset: str = "default", **options: Any) -> Run:
    return plan_and_learn(
        task, preset=preset, settings=CHANGES[preset], seed=3, out=out, quiet=True, **options
    )


@without_pictures()
def resume(task: Task, out: Path, **options: Any) -> Run:
    """Continue with nothing but the folder: settings, seed and domain are the run's own."""
    return plan_and_learn(task, out=out, resume=True, quiet=True, **options)


def everything(folder: Path) -> tuple[Any, ...]:
    """Whatever a run has left behind, but for the time it took."""
    with open(folder / "metrics.csv", newline="") as file:
        rows = [{**row, "wall_time": ""} for row in csv.DictReader(file)]
    arrays, meta = load(folder / NEWEST)
    del meta["wall_time"], meta["tables"]  # the times are in the table, so its length differs
    return (
        rows,
        (folder / "decisions.csv").read_bytes(),
        {name: (a.dtype, a.shape, a.tobytes()) for name, a in sorted(arrays.items())},
        json.dumps(meta, sort_keys=True),
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Any, ...]]:
    """What an undisturbed run of a preset leaves behind."""
    made: dict[str, tuple[Any, ...]] = {}

    def get(preset: str) -> tuple[Any, ...]:
        if preset not in made:
            folder = tmp_path_factory.mktemp("whole")
            train(corridor(folder), folder / "run", preset, episodes=EPISODES)
            made[preset] = everything(folder / "run")
        return made[preset]

    return get


Whole = Callable[[str], tuple[Any, ...]]

# Stopping and going on ----------------------------------------------------------------------------


@pytest.mark.parametrize("preset", PRESETS)
def test_a_run_continued_twice_equals_an_undisturbed_one(
    tmp_path: Path, preset: str, whole: Whole
) -> None:
    task, out = corridor(tmp_path), tmp_path / "run"
    first, second = sorted(Random(preset).sample(range(1, EPISODES), 2))
    train(task, out, preset, episodes=first)
    resume(task, out, episodes=second)
    resume(task, out, episodes=EPISODES)
    assert everything(out) == whole(preset)


@pytest.mark.parametrize("preset", PRESETS)
def test_a_run_that_died_in_an_episode_continues_as_if_it_had_not(
    tmp_path: Path, preset: str, whole: Whole
) -> None:
    """The environment raises; what was written after the last checkpoint is taken back."""
    steps, out = len(whole(preset)[1].splitlines()) - 1, tmp_path / "run"
    at = Random(preset).randint(2, steps)
    with pytest.raises(EnvironmentFailure, match="cable cut"):
        train(corridor(tmp_path, lambda: CableCut(Corridor(), at)), out, preset, episodes=EPISODES)
    assert len((out / "decisions.csv").read_text().splitlines()) == at + 1
    resume(corridor(tmp_path), out)  # to the budget that it began with
    assert everything(out) == whole(preset)


def test_a_run_that_died_in_its_first_episode_continues_too(tmp_path: Path, whole: Whole) -> None:
    with pytest.raises(EnvironmentFailure):
        train(
            corridor(tmp_path, lambda: CableCut(Corridor(), 1)), tmp_path / "run", episodes=EPISODES
        )
    resume(corridor(tmp_path), tmp_path / "run")
    assert everything(tmp_path / "run") == whole("default")


KILLED = """
import os, signal
from pathlib import Path
from tests.serp.tasks import Corridor, corridor
from tests.serp.test_run import EPISODES, train

class Killed(Corridor):
    def step(self, action):
        if self.made == 40:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().step(action)

folder = Path({folder!r})
train(corridor(folder, Killed), folder / "run", episodes=EPISODES)
"""


def test_a_killed_process_leaves_a_run_that_continues(tmp_path: Path, whole: Whole) -> None:
    path = os.pathsep.join(["."] + [p for p in sys.path if p])
    killed = subprocess.run(
        [sys.executable, "-c", KILLED.format(folder=str(tmp_path))],
        env={**os.environ, "PYTHONPATH": path},
        cwd=Path(__file__).parents[2],
        capture_output=True,
        timeout=120,
        check=False,
    )
    assert killed.returncode == -signal.SIGKILL, killed.stderr.decode()
    resume(corridor(tmp_path), tmp_path / "run")
    assert everything(tmp_path / "run") == whole("default")


def test_ctrl_c_finishes_the_episode_and_leaves_a_run_that_continues(
    tmp_path: Path, whole: Whole
) -> None:
    class Stopped(Corridor):
        def step(self, action: int) -> Any:
            if self.made == 20:
                os.kill(os.getpid(), signal.SIGINT)
            return super().step(action)

    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(Interrupted, match=r"stopped after \d episodes, 2\d env steps"):
        train(corridor(tmp_path, Stopped), tmp_path / "run", episodes=EPISODES)
    assert signal.getsignal(signal.SIGINT) is before
    assert (tmp_path / "run" / "summary.json").exists()
    resume(corridor(tmp_path), tmp_path / "run")
    assert everything(tmp_path / "run") == whole("default")


def test_a_second_ctrl_c_stops_at_once(tmp_path: Path, whole: Whole) -> None:
    class Stopped(Corridor):
        def step(self, action: int) -> Any:
            if self.made in (20, 21):
                os.kill(os.getpid(), signal.SIGINT)
            return super().step(action)

    with pytest.raises(KeyboardInterrupt):
        train(corridor(tmp_path, Stopped), tmp_path / "run", episodes=EPISODES)
    resume(corridor(tmp_path), tmp_path / "run")
    assert everything(tmp_path / "run") == whole("default")


def test_training_works_in_another_thread_too(tmp_path: Path, whole: Whole) -> None:
    """Where there are no signals to handle."""
    thread = threading.Thread(
        target=train, args=(corridor(tmp_path), tmp_path / "run"), kwargs={"episodes": EPISODES}
    )
    thread.start()
    thread.join()
    assert everything(tmp_path / "run") == whole("default")


def test_the_budget_in_env_steps_ends_with_the_episode_that_reaches_it(tmp_path: Path) -> None:
    run = train(corridor(tmp_path), tmp_path / "run", env_steps=30)
    steps = run.metrics["env_steps"]
    assert steps[-1] >= 30 > steps[-2]
    again = resume(corridor(tmp_path), tmp_path / "run")
    assert (again.metrics["env_steps"] == steps).all()


# The run's own domain, settings, task -------------------------------------------------------------


def test_a_run_goes_on_with_its_own_domain_whatever_became_of_the_file(
    tmp_path: Path, whole: Whole
) -> None:
    task, out = corridor(tmp_path), tmp_path / "run"
    train(task, out, episodes=5)
    (tmp_path / "corridor.pddl").write_text("(define (domain corridor) (oops")
    resume(task, out, episodes=EPISODES)
    assert everything(out) == whole("default")


def test_a_run_goes_on_with_its_own_control_period_and_reward(tmp_path: Path, whole: Whole) -> None:
    out = tmp_path / "run"
    train(corridor(tmp_path), out, episodes=5)
    resume(corridor(tmp_path, dt=0.5, reward="environment"), out, episodes=EPISODES)
    assert everything(out) == whole("default")


def test_a_run_of_another_task_is_refused(tmp_path: Path) -> None:
    train(corridor(tmp_path), tmp_path / "run", episodes=1)
    with pytest.raises(RunError, match="a run of task corridor, not of maze"):
        resume(corridor(tmp_path, name="maze"), tmp_path / "run")
    with pytest.raises(RunError, match="not of maze"):
        load_run(tmp_path / "run", corridor(tmp_path, name="maze"))


def test_a_finished_run_has_its_results(tmp_path: Path) -> None:
    run = plan_and_learn(corridor(tmp_path), episodes=3, seed=3, out=tmp_path / "run", quiet=True)
    names = {file.name for file in (tmp_path / "run").iterdir()}
    assert names >= {
        "config.json",
        "domain.pddl",
        "metrics.csv",
        "decisions.csv",
        NEWEST,
        "summary.json",
        "report.md",
        "learning-curve.png",
        "learning-curve.svg",
    }
    assert all((tmp_path / "run" / name).stat().st_size for name in names - {".lock"})
    assert len(run.metrics["episode"]) == 3
    assert run.config["seed"] == 3
    assert run.summary["episodes"] == 3


# Bad input ----------------------------------------------------------------------------------------


def test_an_out_that_holds_something_is_left_alone(tmp_path: Path) -> None:
    out = tmp_path / "run"
    out.mkdir()
    (out / "thesis.tex").write_text("all my work")
    with pytest.raises(RunError, match="run"):
        train(corridor(tmp_path), out, episodes=1)
    assert [file.name for file in out.iterdir()] == ["thesis.tex"]


def test_a_second_training_does_not_overwrite_a_run(tmp_path: Path) -> None:
    train(corridor(tmp_path), tmp_path / "run", episodes=1)
    before = everything(tmp_path / "run")
    with pytest.raises(RunError):
        train(corridor(tmp_path), tmp_path / "run", episodes=1)
    assert everything(tmp_path / "run") == before


def test_a_task_that_does_not_fit_leaves_no_folder(tmp_path: Path) -> None:
    with pytest.raises(TaskError):
        train(corridor(tmp_path, actions={"left": 0}), tmp_path / "run", episodes=1)
    with pytest.raises(SettingsError):
        plan_and_learn(
            corridor(tmp_path), settings={"arbiter": {"roh": 1.0}}, out=tmp_path / "run", quiet=True
        )
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"episodes": 0}, "at least 1"),
        ({"env_steps": -5}, "at least 1"),
        ({"seed": -1}, "seed must be 0 or more"),
        ({"preset": "papre"}, "no preset `papre`; did you mean `paper`"),
        ({"resume": True}, "name the run's folder"),
    ],
)
def test_options_that_make_no_sense_are_refused(
    tmp_path: Path, options: dict[str, Any], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises((RunError, SettingsError), match=said):
        plan_and_learn(corridor(tmp_path), quiet=True, **options)
    assert not (tmp_path / "runs").exists()


def half(file: Path) -> None:
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2])


def test_a_checkpoint_cut_in_half_falls_back_to_the_one_before(
    tmp_path: Path, whole: Whole
) -> None:
    out = tmp_path / "run"
    train(corridor(tmp_path), out, episodes=7)
    half(out / NEWEST)
    resume(corridor(tmp_path), out, episodes=EPISODES)
    assert everything(out) == whole("default")
    assert (out / DAMAGED).exists()


def test_two_checkpoints_cut_in_half_are_an_error_and_nothing_is_touched(tmp_path: Path) -> None:
    out = tmp_path / "run"
    train(corridor(tmp_path), out, episodes=4)
    half(out / NEWEST)
    half(out / PREVIOUS)
    before = {file.name: file.read_bytes() for file in out.iterdir() if file.name != ".lock"}
    attempts: tuple[Callable[[], Any], ...] = (
        lambda: resume(corridor(tmp_path), out, episodes=5),
        lambda: load_run(out, corridor(tmp_path)).evaluate(episodes=1),
    )
    for broken in attempts:
        with pytest.raises(RunError, match="damaged"):
            broken()
    assert before == {f.name: f.read_bytes() for f in out.iterdir() if f.name != ".lock"}


def changed(out: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    config = json.loads((out / "config.json").read_text())
    change(config["config"])
    (out / "config.json").write_text(json.dumps(config))


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finished")
    train(corridor(folder), folder / "run", episodes=2)
    return folder


@pytest.mark.parametrize(
    "change",
    [
        lambda config: config.pop("settings"),
        lambda config: config.pop("seed"),
        lambda config: config.pop("task"),
        lambda config: config.pop("control_period"),
        lambda config: config.update(seed="three"),
        lambda config: config.update(reward="mine"),
        lambda config: config.update(control_period=None),
        lambda config: config.update(settings=5),
        lambda config: config["settings"].update(planner=5),
        lambda config: config["settings"]["planner"].update(depth="deep"),
        lambda config: config["settings"]["planner"].update(dept=3),
        lambda config: config["settings"]["arbiter"].update(rho="high"),
    ],
)
def test_a_configuration_that_was_broken_is_named_with_what_is_wrong(
    finished: Path, change: Callable[[dict[str, Any]], Any]
) -> None:
    kept = (finished / "run" / "config.json").read_text()
    try:
        changed(finished / "run", change)
        attempts: tuple[Callable[[], Any], ...] = (
            lambda: resume(corridor(finished), finished / "run", episodes=3),
            lambda: load_run(finished / "run", corridor(finished)),
        )
        for broken in attempts:
            with pytest.raises(RunError, match=r"config\.json was changed or damaged: .+"):
                broken()
    finally:
        (finished / "run" / "config.json").write_text(kept)


def test_a_folder_that_is_no_run_is_refused(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(RunError, match="no run"):
            load_run(folder)
        with pytest.raises(RunError, match="no run"):
            resume(corridor(tmp_path), folder)


# Using what came out ------------------------------------------------------------------------------


def test_a_loaded_run_decides_as_the_trained_one(tmp_path: Path) -> None:
    trained = train(corridor(tmp_path), tmp_path / "run", episodes=8)
    loaded = load_run(tmp_path / "run", corridor(tmp_path))
    for x in range(-2, 4):
        seen = np.array([float(x), 0.3])
        one, other = trained.decide(seen), loaded.decide(seen)
        assert one.action == other.action
        assert one.reason is other.reason
        assert not one.unsafe
    results = [run.evaluate("serp", episodes=3, seed=5) for run in (trained, loaded)]
    assert results[0].lengths == results[1].lengths


def test_a_task_that_is_not_installed_must_be_given(tmp_path: Path) -> None:
    train(corridor(tmp_path), tmp_path / "run", episodes=1)
    with pytest.raises(TaskError, match="no task `corridor`"):
        load_run(tmp_path / "run")
