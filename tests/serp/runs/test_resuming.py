"""Whatever stops a run, continuing it gives what an undisturbed one gives."""

import errno
import re
from random import Random

import numpy as np
import pytest

from serp.errors import EnvironmentFailure, RunError, TaskError
from serp.runs.checkpoint import CHECKPOINT
from serp.runs.recording import Recorder
from serp.runs.tables import METRICS_COLUMNS
from serp.runs.train import plan_and_learn
from tests.serp.runs.runs import EPISODES, everything, resume, train
from tests.serp.sample_tasks import CableCut, Corridor, corridor


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """What an undisturbed run of a preset leaves behind."""
    made = {}

    def get(preset):
        if preset not in made:
            folder = tmp_path_factory.mktemp("whole")
            train(corridor(folder), folder / "run", preset, episodes=EPISODES)
            made[preset] = everything(folder / "run")
        return made[preset]

    return get


def cut(at, preset="default"):
    def stop(folder, out):
        """The environment raises; what was written after the last checkpoint is taken back."""
        with pytest.raises(EnvironmentFailure, match="cable cut") as failure:
            task = corridor(folder, lambda: CableCut(Corridor(), at))
            train(task, out, preset, episodes=EPISODES)
        assert len((out / "decisions.csv").read_text().splitlines()) == at
        where, note = failure.value.__notes__
        assert re.search(rf"in step {at - 1} of the training, episode \d", where)
        assert f"kept in {out}" in note
        assert f"serp plan-and-learn --resume '{out}'" in note
        assert f"plan_and_learn(task, out={str(out)!r}, resume=True)" in note

    return stop


def failing_grounding(folder, out):
    left = iter(range(30))

    def ground(seen):
        return {"x": seen[0] if next(left, None) is not None else float("nan")}

    with pytest.raises(TaskError) as failure:
        train(corridor(folder, ground=ground), out, episodes=EPISODES)
    assert "--resume" in failure.value.__notes__[1]


def twice(preset):
    def stop(folder, out):
        first, second = sorted(Random(preset).sample(range(1, EPISODES), 2))
        train(corridor(folder), out, preset, episodes=first)
        resume(corridor(folder), out, episodes=second)

    return stop


def another_task(folder, out):
    """The domain, the control period and the reward of a run are its own."""
    train(corridor(folder), out, episodes=5)
    resume(corridor(folder, dt=0.5, reward="environment"), out, episodes=6)


@pytest.mark.parametrize(
    ("stop", "preset"),
    [
        (cut(1), "default"),
        (cut(51), "default"),
        (cut(60, "paper"), "paper"),
        (twice("default"), "default"),
        (twice("paper"), "paper"),
        (failing_grounding, "default"),
        (another_task, "default"),
    ],
)
def test_a_run_that_was_stopped_continues_as_if_it_had_not(tmp_path, stop, preset, whole):
    out = tmp_path / "my run"
    stop(tmp_path, out)
    (tmp_path / "corridor.pddl").write_text("(define (domain corridor) (oops")
    resume(corridor(tmp_path), out, episodes=EPISODES)
    assert everything(out) == whole(preset)


def test_a_finished_run_has_nothing_left_to_do_and_keeps_its_checkpoint(tmp_path):
    """The budget in env steps ends with the episode that reaches it."""
    out = tmp_path / "run"
    steps = train(corridor(tmp_path), out, env_steps=np.int64(30)).metrics["env_steps"]
    assert steps[-1] >= 30 > steps[-2]
    kept = (out / CHECKPOINT).read_bytes()
    assert (resume(corridor(tmp_path), out).metrics["env_steps"] == steps).all()
    assert (out / CHECKPOINT).read_bytes() == kept


@pytest.mark.parametrize("length", [None, 0, 9, -1])
def test_a_run_that_was_killed_before_its_first_checkpoint_begins_anew(tmp_path, length, whole):
    out = tmp_path / "run"
    train(corridor(tmp_path), out, episodes=1)
    for file in out.iterdir():
        if file.name in (CHECKPOINT, "decisions.csv", "metrics.csv"):
            file.unlink()
    if length is not None:
        (out / "metrics.csv").write_text(f"{','.join(METRICS_COLUMNS)}\n\n"[:length])
    resume(corridor(tmp_path), out, episodes=EPISODES)
    assert everything(out)[1] == whole("default")[1]


def test_environment_and_events_are_closed_however_a_training_ends(tmp_path, monkeypatch):
    class Closing(CableCut):
        def close(self):
            closed.append("environment")
            super().close()

    def task(at):
        return corridor(tmp_path, lambda: Closing(Corridor(), at))

    def close(self):
        closed.append("recording")
        raise OSError(errno.ENOSPC, "No space left on device")

    closed = []
    monkeypatch.setattr(Recorder, "close", close)
    for at, kind in ((3, EnvironmentFailure), (10**6, OSError)):  # no error hides another
        with pytest.raises(kind):
            plan_and_learn(task(at), episodes=2, out=tmp_path / str(at), quiet=True)
    assert closed == ["recording", "environment"] * 2
    with pytest.raises(RunError):
        train(task(10**6), tmp_path / "3", episodes=2)  # there is a run already
    assert len(closed) == 4  # no environment is made for a run that cannot begin
