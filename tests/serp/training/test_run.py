"""Runs on the disk: whatever stops one, continuing it gives what an undisturbed one gives."""

from __future__ import annotations

import contextlib
import csv
import errno
import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import NormalizeObservation, NormalizeReward, TimeLimit

from serp.diagnosis.recorded_run import read_recorded
from serp.errors import (
    EnvironmentFailure,
    Interrupted,
    LearningFailure,
    RunError,
    SerpError,
    SettingsError,
    TaskError,
)
from serp.learning.learning import QLearning
from serp.model.loading import load_domain
from serp.model.transition_model import StateError
from serp.runs.checkpoint import DAMAGED, NEWEST, PREVIOUS, load
from serp.runs.folder import RunFolder
from serp.runs.rows import MetricsRow
from serp.runs.tensorboard import EventWriter
from serp.tasks.task import Task
from serp.training.plan_and_learn import plan_and_learn
from serp.training.run import Run, load_run
from serp.training.run_metadata import read_run_metadata
from tests.serp.sample_tasks import CableCut, Corridor, corridor, corridor_file

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
        patch.setattr("serp._util.figures.render", lambda figure, kind: b"")
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

# Failures ---------------------------------------------------------------------------------------


class Recorder(EventWriter):
    """Events that are not written; whether they were closed."""

    closed: ClassVar[list[Path]] = []

    def __init__(self, folder: Path, purge_step: int | None = None) -> None:
        self.folder = folder

    def append(self, row: MetricsRow) -> None:
        pass

    def flush(self) -> None:
        pass

    def close(self) -> None:
        self.closed.append(self.folder)
        raise OSError(errno.ENOSPC, "No space left on device")


def grounding_that_fails_after(calls: int) -> Callable[[Any], Any]:
    left = iter(range(calls))
    return lambda seen: {"x": seen[0] if next(left, None) is not None else float("nan")}


FAILURES: list[tuple[type[Exception], Callable[[Path], Task]]] = [
    (EnvironmentFailure, lambda f: corridor(f, lambda: CableCut(Corridor(), 30))),
    (TaskError, lambda f: corridor(f, ground=grounding_that_fails_after(30))),
]


@pytest.mark.parametrize(("kind", "make"), FAILURES, ids=["environment", "grounding"])
def test_a_failure_says_what_is_kept_and_how_to_go_on(
    tmp_path: Path, kind: type[Exception], make: Callable[[Path], Task], whole: Whole
) -> None:
    out = tmp_path / "my run"
    with pytest.raises(kind) as failure:
        train(make(tmp_path), out, episodes=EPISODES)
    where, note = failure.value.__notes__
    assert re.search(r"in env step \d+ of the training, episode \d", where)
    assert f"kept in {out}" in note
    assert f"serp plan-and-learn --resume '{out}'" in note
    assert f"plan_and_learn(task, out={str(out)!r}, resume=True)" in note
    resume(corridor(tmp_path), out)
    assert everything(out) == whole("default")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")
def test_a_full_disk_says_what_is_kept_and_how_to_go_on(tmp_path: Path, whole: Whole) -> None:
    saves = 0

    def save_checkpoint(self: RunFolder, *state: Any) -> Any:
        nonlocal saves
        saves += 1
        if saves == 4:  # from here on the table meets a full disk
            full = os.open("/dev/full", os.O_WRONLY)
            os.dup2(full, self.metrics._file.fileno())
            os.close(full)
        return saved(self, *state)

    saved = RunFolder.save_checkpoint
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RunFolder, "save_checkpoint", save_checkpoint)
        with pytest.raises(RunError, match="No space left on device") as failure:
            train(corridor(tmp_path), tmp_path / "run", episodes=EPISODES)
    assert "--resume" in failure.value.__notes__[0]
    resume(corridor(tmp_path), tmp_path / "run")
    assert everything(tmp_path / "run") == whole("default")


def test_a_failure_before_the_first_checkpoint_promises_nothing(tmp_path: Path) -> None:
    class Opaque(Corridor):
        def state_dict(self) -> dict[str, Any]:
            raise RuntimeError("no state")

    with pytest.raises(EnvironmentFailure) as failure:
        train(corridor(tmp_path, Opaque), tmp_path / "run", episodes=1)
    assert not hasattr(failure.value, "__notes__")


def test_a_setting_that_turns_out_wrong_cannot_be_mended_by_resuming(tmp_path: Path) -> None:
    settings = {"arbiter": {"rho_unit": "match"}}
    with pytest.raises(SettingsError, match="`match`") as failure:
        plan_and_learn(corridor(tmp_path), settings=settings, out=tmp_path / "run", quiet=True)
    assert not hasattr(failure.value, "__notes__")


@pytest.mark.parametrize("at", [30, 10**6])
def test_the_event_writer_is_closed_and_hides_no_error(
    tmp_path: Path, at: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("serp.training.plan_and_learn.EventWriter", Recorder)
    monkeypatch.setattr("serp.training.plan_and_learn.require_tensorboard", lambda: None)
    monkeypatch.setattr(Recorder, "closed", [])
    task = corridor(tmp_path, lambda: CableCut(Corridor(), at))
    kind = EnvironmentFailure if at == 30 else OSError  # where all else went well, its own
    with pytest.raises(kind):
        plan_and_learn(
            task,
            settings={"training": {"tensorboard": True}},
            episodes=EPISODES,
            out=tmp_path / "run",
            quiet=True,
        )
    assert Recorder.closed == [tmp_path / "run"]


def test_the_environment_is_closed_however_a_training_ends(tmp_path: Path) -> None:
    class Closing(CableCut):
        def close(self) -> None:
            closed.append("closed")
            super().close()

    def task(at: int) -> Task:
        return corridor(tmp_path, lambda: Closing(Corridor(), at))

    closed: list[str] = []
    train(task(10**6), tmp_path / "run", episodes=2)
    assert closed == ["closed"]
    with pytest.raises(EnvironmentFailure):
        resume(task(3), tmp_path / "run", episodes=9)
    with pytest.raises(RunError):
        train(task(10**6), tmp_path / "run", episodes=2)  # there is a run already
    half(tmp_path / "run" / NEWEST)
    half(tmp_path / "run" / PREVIOUS)
    with pytest.raises(RunError):
        resume(task(10**6), tmp_path / "run", episodes=9)
    assert closed == ["closed"] * 4


# What wrappers carry ------------------------------------------------------------------------------


def normalizing(folder: Path) -> Task:
    """The learner sees normalised observations; the grounding undoes it with nothing but `info`."""

    def make() -> Any:
        return NormalizeReward(NormalizeObservation(TimeLimit(Plain(), 9)))

    return corridor(folder, make, ground=lambda seen: {"x": round(float(seen[0]), 1)})


class Plain(Corridor):
    """Nothing outlives its reset, so nothing of it has to be saved."""

    def reset(self, **options: Any) -> Any:
        self.clock = 0
        self.weather = np.random.default_rng(5)
        return super().reset(**options)


def test_running_statistics_of_wrappers_are_resumed_bit_for_bit(tmp_path: Path) -> None:
    train(normalizing(tmp_path), tmp_path / "whole", episodes=8)
    train(normalizing(tmp_path), tmp_path / "run", episodes=3)
    resume(normalizing(tmp_path), tmp_path / "run", episodes=6)
    resume(normalizing(tmp_path), tmp_path / "run", episodes=8)
    assert everything(tmp_path / "run") == everything(tmp_path / "whole")


def test_an_evaluation_sees_what_the_learner_learned_to_see(tmp_path: Path) -> None:
    run = train(normalizing(tmp_path), tmp_path / "run", episodes=6)
    counts: list[float] = []

    class Seen(NormalizeObservation):  # type: ignore[type-arg]
        def reset(self, **options: Any) -> Any:
            counts.append(self.obs_rms.count)
            return super().reset(**options)

    def make() -> Any:
        return NormalizeReward(Seen(TimeLimit(Plain(), 9)))

    ground = normalizing(tmp_path).ground
    load_run(run.path, corridor(tmp_path, make, ground=ground)).evaluate(episodes=1)
    steps = run.metrics["env_steps"][-1]
    assert counts == [pytest.approx(steps + 6, abs=1)]  # each reset counts as well


class Forgotten(gym.Wrapper[Any, Any, Any, Any]):
    """Carries on what nobody saves."""

    def __init__(self, env: Any) -> None:
        super().__init__(env)
        self.wear = 0.0

    def step(self, action: Any) -> Any:
        self.wear += 0.001
        return super().step(action)


def test_a_wrapper_whose_memory_is_not_saved_is_named_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with without_pictures():
        plan_and_learn(
            corridor(tmp_path, lambda: Forgotten(Corridor())), episodes=12, out=tmp_path / "run"
        )
    shown = capsys.readouterr().err
    assert shown.count("Wrapper Forgotten keeps `wear` from one episode to the next") == 1
    with without_pictures():
        plan_and_learn(normalizing(tmp_path), episodes=12, out=tmp_path / "other")
    assert "Wrapper" not in capsys.readouterr().err


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


@pytest.mark.parametrize(
    ("preset", "first"), [("paper", False), ("default", False), ("default", True)]
)
def test_a_run_that_died_in_an_episode_continues_as_if_it_had_not(
    tmp_path: Path, preset: str, first: bool, whole: Whole
) -> None:
    """The environment raises; what was written after the last checkpoint is taken back."""
    steps, out = len(whole(preset)[1].splitlines()) - 1, tmp_path / "run"
    at = 1 if first else Random(preset).randint(2, steps)
    with pytest.raises(EnvironmentFailure, match="cable cut"):
        train(corridor(tmp_path, lambda: CableCut(Corridor(), at)), out, preset, episodes=EPISODES)
    assert len((out / "decisions.csv").read_text().splitlines()) == at + 1
    resume(corridor(tmp_path), out)  # to the budget that it began with
    assert everything(out) == whole(preset)


KILLED = """
import os, signal
from pathlib import Path
from tests.serp.sample_tasks import Corridor, corridor
from tests.serp.training.test_run import EPISODES, train

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
        cwd=Path(__file__).parents[3],
        capture_output=True,
        timeout=120,
        check=False,
    )
    assert killed.returncode == -signal.SIGKILL, killed.stderr.decode()
    resume(corridor(tmp_path), tmp_path / "run")
    assert everything(tmp_path / "run") == whole("default")


class Patient(Corridor):
    """An episode of 12 steps, in which Ctrl-C is pressed at the third step (and the sixth)."""

    presses = (20,)

    def step(self, action: int) -> Any:
        if self.made in self.presses:
            os.kill(os.getpid(), signal.SIGINT)
        return super().step(action)


class Impatient(Patient):
    presses = (20, 22)


@pytest.mark.parametrize(("make", "ends"), [(Patient, Interrupted), (Impatient, KeyboardInterrupt)])
def test_the_first_ctrl_c_says_what_happens_and_what_a_second_would_do(
    tmp_path: Path,
    make: type[Patient],
    ends: type[BaseException],
    whole: Whole,
    capsys: pytest.CaptureFixture[str],
) -> None:
    before = signal.getsignal(signal.SIGINT)
    with without_pictures(), pytest.raises(ends) as stopped:
        plan_and_learn(
            corridor(tmp_path, make), settings=CHANGES["default"], seed=3, episodes=EPISODES,
            out=tmp_path / "run",
        )  # fmt: skip
    assert signal.getsignal(signal.SIGINT) is before
    assert (tmp_path / "run" / "summary.json").exists() == (ends is Interrupted)
    shown = capsys.readouterr().err
    assert shown.count("finishing the episode") == 1
    assert "Press it again to stop at once" in shown
    if ends is KeyboardInterrupt:
        assert "--resume" in stopped.value.__notes__[0]
    else:
        assert re.search(r"stopped after \d episodes, [23]\d env steps", str(stopped.value))
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


def test_a_run_goes_on_with_its_own_domain_period_and_reward_whatever_became_of_the_task(
    tmp_path: Path, whole: Whole
) -> None:
    task, out = corridor(tmp_path), tmp_path / "run"
    train(task, out, episodes=5)
    other = corridor(tmp_path, dt=0.5, reward="environment")
    (tmp_path / "corridor.pddl").write_text("(define (domain corridor) (oops")
    resume(other, out, episodes=EPISODES)
    assert everything(out) == whole("default")


def test_a_run_of_a_domain_beyond_the_usual_limit_goes_on_within_its_own(tmp_path: Path) -> None:
    domain = load_domain(corridor_file(tmp_path), max_ground_schemas=9)
    train(corridor(tmp_path, domain=domain), tmp_path / "run", episodes=2)
    resume(corridor(tmp_path), tmp_path / "run", episodes=3)
    assert read_run_metadata(RunFolder.open(tmp_path / "run")).max_ground_schemas == 9
    assert read_recorded(tmp_path / "run").domain.max_ground_schemas == 9


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
        ({"episodes": 0}, "budget.episodes must be greater than or equal to 1, not 0"),
        ({"episodes": "3"}, "budget.episodes must be a whole number, not '3'"),
        ({"env_steps": 1.5}, "budget.env_steps must be a whole number, not 1.5"),
        ({"episodes": True}, "episodes must be"),
        ({"seed": -1}, "seed must be a whole number, 0 or more, not -1"),
        ({"seed": 1.5}, "seed must be a whole number, 0 or more, not 1.5"),
        ({"seed": None}, "seed must be a whole number, 0 or more, not None"),
        ({"out": 3}, "out must be the name of a folder, not 3"),
        ({"settings": {"arbiter": 3}}, "section `arbiter` must be a mapping"),
        ({"settings": 3}, "settings must be a mapping"),
        ({"preset": 3}, "no preset `3`"),
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


def test_what_is_no_task_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TaskError, match="a task is a serp.Task, a name or a domain file, not 3"):
        plan_and_learn(3, out=tmp_path / "run")  # type: ignore[arg-type]


def test_numpys_numbers_are_as_good_as_pythons(tmp_path: Path) -> None:
    """A run of them has the configuration of a run of Python's, and goes on."""
    configs = []
    for kind, whole_number, real_number in (
        ("numpy", np.int64, np.float64),
        ("python", int, float),
    ):
        out = tmp_path / kind
        run = plan_and_learn(
            corridor(tmp_path, dt=real_number(0.5)),
            settings={
                "planner": {"depth": whole_number(1)},
                "learner": {"discount": real_number(0.5), "hidden": [whole_number(4)]},
            },
            episodes=whole_number(1),
            env_steps=whole_number(500),
            seed=whole_number(3),
            out=out,
            quiet=True,
        )
        configs.append(run.config)
        resume(corridor(tmp_path), out, episodes=whole_number(2))
    assert configs[0] == configs[1]


def test_every_json_of_a_run_is_strict(tmp_path: Path) -> None:
    """Infinite settings, and bounds of returns that nothing was seen of yet."""

    def refuse(word: str) -> None:
        raise AssertionError(word)

    settings = {"arbiter": {"exploration_slack": float("inf")}, "learner": {"clip_targets": True}}
    with without_pictures():
        plan_and_learn(
            corridor(tmp_path), settings=settings, episodes=1, out=tmp_path / "run", quiet=True
        )
    run = tmp_path / "run"
    data = (run / NEWEST).read_bytes()
    header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")], parse_constant=refuse)
    texts = [(run / "config.json").read_text(), (run / "summary.json").read_text()]
    for text in (*texts, header["__metadata__"]["serp"]):
        json.loads(text, parse_constant=refuse)
    resume(corridor(tmp_path), run, episodes=2)


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
        with pytest.raises(RunError, match="is not a run|there is no run"):
            load_run(folder)
        with pytest.raises(RunError, match="is not a run|there is no run"):
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


def test_a_problem_that_was_put_beside_a_runs_domain_is_not_taken_for_its_own(
    tmp_path: Path,
) -> None:
    out = tmp_path / "run"
    train(corridor(tmp_path), out, episodes=2)
    problem = "(define (problem p) (:domain corridor))"
    (out / "domain-problem.pddl").write_text(problem, encoding="utf-8")
    with pytest.raises(RunError, match=r"domain-problem\.pddl of the run was changed since"):
        train(corridor(tmp_path), out, resume=True)


def test_a_run_whose_own_files_were_changed_is_not_continued(tmp_path: Path) -> None:
    out = tmp_path / "run"
    train(corridor(tmp_path), out, episodes=2)
    for name, old, new in (
        ("domain.pddl", "(reward) 5", "(reward) 6"),
        ("config.json", '"seed": ', '"seed": 1'),
    ):
        file = out / name
        before = file.read_text(encoding="utf-8")
        assert old in before
        file.write_text(before.replace(old, new), encoding="utf-8")
        with pytest.raises(RunError, match=f"{name} of the run was changed since it began"):
            resume(corridor(tmp_path), out, episodes=3)
        with pytest.raises(RunError, match=f"{name} of the run was changed"):
            _ = load_run(out, corridor(tmp_path)).agent
        file.write_text(before, encoding="utf-8")
    resume(corridor(tmp_path), out, episodes=3)


def test_a_learner_that_does_not_fit_into_memory_leaves_no_run(tmp_path: Path) -> None:
    for learner in ({"buffer_size": 10**13}, {"hidden": [10**9]}):
        with pytest.raises(SettingsError, match="do not fit into"):
            plan_and_learn(
                corridor(tmp_path), out=tmp_path / "run", settings={"learner": learner}, quiet=True
            )
        assert not (tmp_path / "run").exists()


def test_a_reward_without_a_value_is_said_with_its_place_and_without_advice_that_loops(
    tmp_path: Path,
) -> None:
    task = corridor(tmp_path)
    file = Path(str(task.domain))
    text = file.read_text(encoding="utf-8")
    event = (
        "(:event odd :parameters () :precondition (and (> (/ 1 (- (x) (x))) 2))"
        " :effect (and (increase (reward) 1)))"
    )
    file.write_text(text.rstrip().removesuffix(")") + event + ")", encoding="utf-8")
    with pytest.raises(StateError, match=r"pddl:\d+:\d+: `\(> .* is neither true nor") as raised:
        train(task, tmp_path / "run", episodes=3)
    assert "--resume" not in "".join(raised.value.__notes__)


@pytest.mark.parametrize("folder", [3, None, b"run"])
def test_what_is_no_folder_is_no_run(folder: Any) -> None:
    with pytest.raises(RunError, match="given by its folder"):
        load_run(folder)


def test_an_older_agent_is_not_passed_off_as_the_newest(tmp_path: Path) -> None:
    out = tmp_path / "run"
    assert train(corridor(tmp_path), out, episodes=3).notice is None
    (out / NEWEST).write_bytes(b"x")
    notice = load_run(out, corridor(tmp_path)).notice
    assert notice is not None and notice.endswith("The agent is from the previous checkpoint.")


# Numbers that are not finite ----------------------------------------------------------------------


class Huge(Corridor):
    """Answers with another observation or another reward at one step, counted over all episodes."""

    def __init__(self, seen: Any = None, reward: Any = None) -> None:
        super().__init__()
        self.other = seen, reward

    def step(self, action: int) -> Any:
        seen, reward, *rest = super().step(action)
        if self.made == 30:
            seen = seen if self.other[0] is None else np.array(self.other[0])
            reward = reward if self.other[1] is None else self.other[1]
        return seen, reward, *rest


@pytest.mark.parametrize(
    ("seen", "reward", "said"),
    [
        ([0.0, 1e39], None, "the observation: entry 1 is 1e.39, too large for the learner"),
        ([0.0, np.nan], None, "the observation: entry 1 is nan"),
        ([-1e39, 0.0], None, "entry 0 is -1e.39"),
        (None, -1e39, "rewards such as -1e.39"),
        (None, np.inf, "the reward is inf"),
    ],
)
def test_a_number_that_is_not_finite_stops_a_run_that_can_go_on(
    tmp_path: Path, seen: Any, reward: Any, said: str
) -> None:
    changes = {"reward": "environment"}
    with pytest.raises(SerpError, match=f"{said}.*") as failure:
        train(corridor(tmp_path, lambda: Huge(seen, reward), **changes), tmp_path / "run",
              episodes=EPISODES)  # fmt: skip
    where, advice = failure.value.__notes__
    assert "in env step 30 of" in where and "--resume" in advice
    resume(corridor(tmp_path, **changes), tmp_path / "run")
    train(corridor(tmp_path, **changes), tmp_path / "whole", episodes=EPISODES)
    assert everything(tmp_path / "run")[:3] == everything(tmp_path / "whole")[:3]


@pytest.mark.parametrize("preset", PRESETS)
def test_no_parameter_that_is_not_finite_is_ever_saved(
    tmp_path: Path, preset: str, whole: Whole
) -> None:
    """Neither one that the loss shows, nor one that came about after the last loss."""
    broken: list[int] = []

    def step(self: QLearning) -> None:
        stepped(self)
        if self.updates == 40 and not broken:
            broken.append(self.updates)
            self.arrays()["parameters"][0, 0] = np.nan

    stepped = QLearning.step
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(QLearning, "step", step)
        with pytest.raises(LearningFailure, match="parameters of layer 1") as raised:
            train(corridor(tmp_path), tmp_path / "run", preset, episodes=50)
    assert broken
    assert "env step" in raised.value.__notes__[0]
    for name in (NEWEST, PREVIOUS):
        arrays, _ = load(tmp_path / "run" / name)
        assert np.isfinite(arrays["learner.parameters"]).all()
    resume(corridor(tmp_path), tmp_path / "run", episodes=EPISODES)
    assert everything(tmp_path / "run")[0][:EPISODES] == whole(preset)[0]
