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
from typing import Any

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

# Stopping and continuing --------------------------------------------------------------------------


def cut(at: int, preset: str = "default") -> Callable[[Path, Path], None]:
    def stop(folder: Path, out: Path) -> None:
        """The environment raises; what was written after the last checkpoint is taken back."""
        with pytest.raises(EnvironmentFailure, match="cable cut") as failure:
            task = corridor(folder, lambda: CableCut(Corridor(), at))
            train(task, out, preset, episodes=EPISODES)
        assert len((out / "decisions.csv").read_text().splitlines()) == at + 1
        where, note = failure.value.__notes__
        assert re.search(rf"in env step {at} of the training, episode \d", where)
        assert f"kept in {out}" in note
        assert f"serp plan-and-learn --resume '{out}'" in note
        assert f"plan_and_learn(task, out={str(out)!r}, resume=True)" in note

    return stop


def failing_grounding(folder: Path, out: Path) -> None:
    left = iter(range(30))

    def ground(seen: Any) -> dict[str, float]:
        return {"x": seen[0] if next(left, None) is not None else float("nan")}

    with pytest.raises(TaskError) as failure:
        train(corridor(folder, ground=ground), out, episodes=EPISODES)
    assert "--resume" in failure.value.__notes__[1]


def full_disk(folder: Path, out: Path) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("the system has no /dev/full")
    saved, saves = RunFolder.save_checkpoint, iter(range(4))

    def save_checkpoint(self: RunFolder, *state: Any) -> Any:
        if next(saves, None) == 3:  # from here on the table meets a full disk
            full = os.open("/dev/full", os.O_WRONLY)
            os.dup2(full, self.metrics._file.fileno())
            os.close(full)
        return saved(self, *state)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RunFolder, "save_checkpoint", save_checkpoint)
        with pytest.raises(RunError, match="No space left on device") as failure:
            train(corridor(folder), out, episodes=EPISODES)
    assert "--resume" in failure.value.__notes__[0]


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

train(corridor(Path({folder!r}), Killed), Path({out!r}), episodes=EPISODES)
"""


def kill(folder: Path, out: Path) -> None:
    path = os.pathsep.join(["."] + [p for p in sys.path if p])
    killed = subprocess.run(
        [sys.executable, "-c", KILLED.format(folder=str(folder), out=str(out))],
        env={**os.environ, "PYTHONPATH": path},
        cwd=Path(__file__).parents[3],
        capture_output=True,
        timeout=120,
        check=False,
    )
    assert killed.returncode == -signal.SIGKILL, killed.stderr.decode()


def damaged_checkpoint(folder: Path, out: Path) -> None:
    assert train(corridor(folder), out, episodes=7).notice is None
    half(out / NEWEST)
    notice = load_run(out, corridor(folder)).notice
    assert notice is not None and notice.endswith("The agent is from the previous checkpoint.")


def half(file: Path) -> None:
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2])


def twice(preset: str) -> Callable[[Path, Path], None]:
    def stop(folder: Path, out: Path) -> None:
        first, second = sorted(Random(preset).sample(range(1, EPISODES), 2))
        train(corridor(folder), out, preset, episodes=first)
        resume(corridor(folder), out, episodes=second)

    return stop


def another_task(folder: Path, out: Path) -> None:
    """The domain, the control period and the reward of a run are its own."""
    train(corridor(folder), out, episodes=5)
    resume(corridor(folder, dt=0.5, reward="environment"), out, episodes=6)


def other_thread(folder: Path, out: Path) -> None:
    """There are no signals to handle."""
    given = {"episodes": 5}
    thread = threading.Thread(target=train, args=(corridor(folder), out), kwargs=given)
    thread.start()
    thread.join()


@pytest.mark.parametrize(
    ("stop", "preset"),
    [
        (cut(1), "default"),
        (cut(51), "default"),
        (cut(60, "paper"), "paper"),
        (twice("default"), "default"),
        (twice("paper"), "paper"),
        (failing_grounding, "default"),
        (full_disk, "default"),
        (kill, "default"),
        (damaged_checkpoint, "default"),
        (another_task, "default"),
        (other_thread, "default"),
    ],
)
def test_a_run_that_was_stopped_continues_as_if_it_had_not(
    tmp_path: Path, stop: Callable[[Path, Path], None], preset: str, whole: Whole
) -> None:
    out = tmp_path / "my run"
    stop(tmp_path, out)
    (tmp_path / "corridor.pddl").write_text("(define (domain corridor) (oops")
    resume(corridor(tmp_path), out, episodes=EPISODES)
    assert everything(out) == whole(preset)
    assert (out / DAMAGED).exists() == (stop is damaged_checkpoint)


class Patient(Corridor):
    """Ctrl-C is pressed at the third step of an episode (and at the fifth)."""

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


def test_the_budget_in_env_steps_ends_with_the_episode_that_reaches_it(tmp_path: Path) -> None:
    run = train(corridor(tmp_path), tmp_path / "run", env_steps=np.int64(30))
    steps = run.metrics["env_steps"]
    assert steps[-1] >= 30 > steps[-2]
    again = resume(corridor(tmp_path), tmp_path / "run")
    assert (again.metrics["env_steps"] == steps).all()


def test_two_damaged_checkpoints_are_an_error_and_nothing_is_touched(tmp_path: Path) -> None:
    out = tmp_path / "run"
    train(corridor(tmp_path), out, episodes=4)
    half(out / NEWEST)
    half(out / PREVIOUS)
    before = {file.name: file.read_bytes() for file in out.iterdir() if file.name != ".lock"}
    with pytest.raises(RunError, match="damaged"):
        resume(corridor(tmp_path), out, episodes=5)
    with pytest.raises(RunError, match="damaged"):
        load_run(out, corridor(tmp_path)).evaluate(episodes=1)
    assert before == {f.name: f.read_bytes() for f in out.iterdir() if f.name != ".lock"}


class Opaque(Corridor):
    def state_dict(self) -> dict[str, Any]:
        raise RuntimeError("no state")


def undefined(folder: Path) -> Task:
    """The reward of the domain has no value."""
    task = corridor(folder)
    file = Path(str(task.domain))
    event = (
        "(:event odd :parameters () :precondition (and (> (/ 1 (- (x) (x))) 2))"
        " :effect (and (increase (reward) 1)))"
    )
    text = file.read_text(encoding="utf-8").rstrip().removesuffix(")")
    file.write_text(text + event + ")", encoding="utf-8")
    return task


@pytest.mark.parametrize(
    ("make", "settings", "kind", "said"),
    [
        (lambda f: corridor(f, Opaque), {}, EnvironmentFailure, "no state"),
        (corridor, {"arbiter": {"rho_unit": "match"}}, SettingsError, "`match`"),
        (undefined, {}, StateError, r"pddl:\d+:\d+: `\(> .* is neither true nor"),
    ],
    ids=["no checkpoint", "a wrong setting", "a wrong domain"],
)
def test_no_advice_to_resume_where_that_would_not_help(
    tmp_path: Path, make: Any, settings: Any, kind: type[Exception], said: str
) -> None:
    with pytest.raises(kind, match=said) as failure:
        plan_and_learn(make(tmp_path), settings=settings, out=tmp_path / "run", quiet=True)
    assert "--resume" not in "".join(getattr(failure.value, "__notes__", []))


def test_environment_and_events_are_closed_however_a_training_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Closing(CableCut):
        def close(self) -> None:
            closed.append("environment")
            super().close()

    def task(at: int) -> Task:
        return corridor(tmp_path, lambda: Closing(Corridor(), at))

    def close(self: EventWriter) -> None:
        closed.append("events")
        raise OSError(errno.ENOSPC, "No space left on device")

    closed: list[str] = []
    monkeypatch.setattr(EventWriter, "close", close)
    settings = {"training": {"tensorboard": True}}
    for at, kind in ((3, EnvironmentFailure), (10**6, OSError)):  # no error hides another
        with pytest.raises(kind):
            plan_and_learn(
                task(at), settings=settings, episodes=2, out=tmp_path / str(at), quiet=True
            )
    assert closed == ["events", "environment"] * 2
    with pytest.raises(RunError):
        train(task(10**6), tmp_path / "3", episodes=2)  # there is a run already
    assert closed[4:] == ["environment"]


# What wrappers carry ------------------------------------------------------------------------------


class Plain(Corridor):
    """Nothing outlives its reset, so nothing of it has to be saved."""

    def reset(self, **options: Any) -> Any:
        self.clock = 0
        self.weather = np.random.default_rng(5)
        return super().reset(**options)


def normalizing(folder: Path, wrapper: Any = NormalizeObservation) -> Task:
    """The learner sees normalised observations; the grounding undoes it with nothing but `info`."""

    def make() -> Any:
        return NormalizeReward(wrapper(TimeLimit(Plain(), 9)))

    return corridor(folder, make, ground=lambda seen: {"x": round(float(seen[0]), 1)})


def test_running_statistics_of_wrappers_are_resumed_bit_for_bit(tmp_path: Path) -> None:
    train(normalizing(tmp_path), tmp_path / "whole", episodes=8)
    train(normalizing(tmp_path), tmp_path / "run", episodes=3)
    resume(normalizing(tmp_path), tmp_path / "run", episodes=8)
    assert everything(tmp_path / "run") == everything(tmp_path / "whole")


def test_an_evaluation_sees_what_the_learner_learned_to_see(tmp_path: Path) -> None:
    run = train(normalizing(tmp_path), tmp_path / "run", episodes=6)
    counts: list[float] = []

    class Seen(NormalizeObservation):  # type: ignore[type-arg]
        def reset(self, **options: Any) -> Any:
            counts.append(self.obs_rms.count)
            return super().reset(**options)

    load_run(run.path, normalizing(tmp_path, Seen)).evaluate(episodes=1)
    steps = run.metrics["env_steps"][-1]
    assert counts == [pytest.approx(steps + 6, abs=1)]  # each reset counts as well


# The files of a run -------------------------------------------------------------------------------


def test_a_finished_run_has_its_results(tmp_path: Path) -> None:
    run = plan_and_learn(
        corridor(tmp_path), episodes=3, seed=np.int64(3), out=tmp_path / "run", quiet=True
    )
    names = {file.name for file in (tmp_path / "run").iterdir() if file.stat().st_size}
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
    assert len(run.metrics["episode"]) == 3
    assert run.config["seed"] == 3
    assert run.summary["episodes"] == 3


@without_pictures()
def test_every_json_of_a_run_is_strict(tmp_path: Path) -> None:
    """Infinite settings, and bounds of returns that nothing was seen of yet."""

    def refuse(word: str) -> None:
        raise AssertionError(word)

    settings = {"training": {"slow_step_seconds": float("inf")}, "learner": {"clip_targets": True}}
    run = tmp_path / "run"
    plan_and_learn(corridor(tmp_path), settings=settings, episodes=1, out=run, quiet=True)
    data = (run / NEWEST).read_bytes()
    header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")], parse_constant=refuse)
    texts = [(run / "config.json").read_text(), (run / "summary.json").read_text()]
    for text in (*texts, header["__metadata__"]["serp"]):
        json.loads(text, parse_constant=refuse)
    resume(corridor(tmp_path), run, episodes=2)


def test_a_run_of_a_domain_beyond_the_usual_limit_goes_on_within_its_own(tmp_path: Path) -> None:
    domain = load_domain(corridor_file(tmp_path), max_ground_schemas=9)
    train(corridor(tmp_path, domain=domain), tmp_path / "run", episodes=2)
    resume(corridor(tmp_path), tmp_path / "run", episodes=3)
    assert read_run_metadata(RunFolder.open(tmp_path / "run")).max_ground_schemas == 9
    assert read_recorded(tmp_path / "run").domain.max_ground_schemas == 9


def test_a_loaded_run_decides_as_the_trained_one(tmp_path: Path) -> None:
    trained = train(corridor(tmp_path), tmp_path / "run", episodes=8)
    loaded = load_run(tmp_path / "run", corridor(tmp_path))
    for x in range(-2, 4):
        one, other = (run.decide(np.array([float(x), 0.3])) for run in (trained, loaded))
        assert (one.action, one.reason) == (other.action, other.reason)
        assert not one.unsafe


# Bad input ----------------------------------------------------------------------------------------


def test_a_folder_that_holds_something_is_left_alone(tmp_path: Path) -> None:
    out = tmp_path / "run"
    out.mkdir()
    (out / "thesis.tex").write_text("all my work")
    with pytest.raises(RunError, match="run"):
        train(corridor(tmp_path), out, episodes=1)
    assert [file.name for file in out.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize(
    ("changes", "settings", "kind", "said"),
    [
        ({"actions": {"left": 0}}, {}, TaskError, "no environment action"),
        ({}, {"arbiter": {"roh": 1.0}}, SettingsError, "did you mean `rho`"),
        ({}, {"learner": {"buffer_size": 10**13}}, SettingsError, "do not fit into memory"),
        ({}, {"learner": {"hidden": [10**9]}}, SettingsError, "do not fit into memory"),
    ],
)
def test_what_cannot_be_trained_leaves_no_folder(
    tmp_path: Path, changes: Any, settings: Any, kind: type[Exception], said: str
) -> None:
    with pytest.raises(kind, match=said):
        plan_and_learn(
            corridor(tmp_path, **changes), settings=settings, out=tmp_path / "run", quiet=True
        )
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"episodes": 0}, "budget.episodes must be greater than or equal to 1, not 0"),
        ({"env_steps": 1.5}, "budget.env_steps must be a whole number, not 1.5"),
        ({"seed": -1}, "seed must be a whole number, 0 or more, not -1"),
        ({"out": 3}, "out must be the name of a folder, not 3"),
        ({"settings": 3}, "settings must be a mapping"),
        ({"preset": "papre"}, "no preset `papre`; did you mean `paper`"),
        ({"resume": True}, "name the run's folder"),
        ({"task": 3}, "a task is a serp.Task, a name or a domain file, not 3"),
    ],
)
def test_options_that_make_no_sense_are_refused(
    tmp_path: Path, options: dict[str, Any], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SerpError, match=said):
        plan_and_learn(**{"task": corridor(tmp_path), "quiet": True, **options})
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("folder", [3, None, "", "nowhere"])
def test_what_is_no_run_is_refused(
    folder: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RunError, match="given by its folder|is not a run|there is no run"):
        load_run(folder)


def test_a_run_needs_its_own_task(tmp_path: Path) -> None:
    train(corridor(tmp_path), tmp_path / "run", episodes=1)
    with pytest.raises(TaskError, match="no task `corridor`"):
        load_run(tmp_path / "run")
    with pytest.raises(RunError, match="a run of task corridor, not of maze"):
        resume(corridor(tmp_path, name="maze"), tmp_path / "run")


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("domain.pddl", "(reward) 5", "(reward) 6"),
        ("config.json", '"seed": ', '"seed": 1'),
        ("domain-problem.pddl", "", "(define (problem p) (:domain corridor))"),
    ],
)
def test_a_run_whose_own_files_were_changed_is_not_continued(
    tmp_path: Path, name: str, old: str, new: str
) -> None:
    file = tmp_path / "run" / name
    train(corridor(tmp_path), file.parent, episodes=2)
    before = file.read_text(encoding="utf-8") if old else ""
    assert old in before
    file.write_text(before.replace(old, new), encoding="utf-8")
    said = f"{name} of the run was changed since it began"
    with pytest.raises(RunError, match=said):
        resume(corridor(tmp_path), file.parent, episodes=3)
    with pytest.raises(RunError, match=said):
        _ = load_run(file.parent, corridor(tmp_path)).agent


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


def test_resuming_a_finished_run_keeps_its_checkpoints(tmp_path: Path) -> None:
    task, out = corridor(tmp_path), tmp_path / "run"
    train(task, out, episodes=2)
    kept = [(out / name).read_bytes() for name in (NEWEST, PREVIOUS)]
    resume(task, out)
    assert [(out / name).read_bytes() for name in (NEWEST, PREVIOUS)] == kept
