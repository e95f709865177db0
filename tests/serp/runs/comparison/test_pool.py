"""Trials in other processes: the same records, and nobody dies for another for ever."""

import os
import signal
from pathlib import Path

from serp.runs.comparison.pool import TrialsRequest, run_jobs
from serp.runs.train import Stopping
from tests.serp.runs.comparison.contest import Deadly, Pothole, everything, job, walk


def run(todo, jobs, stopping=None):
    """Run jobs; return name of the folder → what went wrong."""
    lines = []
    ends = run_jobs(todo, TrialsRequest(jobs=jobs), stopping or Stopping(), lines.append)
    return {ended.job.folder.name: ended.error for ended in ends}


def test_processes_find_what_this_one_finds_and_a_lost_one_is_named(
    tmp_path, external, monkeypatch
):
    """Nothing of the working folder is run in another process."""
    monkeypatch.chdir(tmp_path)
    for name in ("pickle", "random", "socket", "numpy", "torch"):
        Path(f"{name}.py").write_text("open('planted', 'a').close()")
    good, bad, deadly = walk(tmp_path), walk(tmp_path, Pothole), walk(tmp_path, Deadly)

    def jobs(folder):
        return [job(good, name, folder / "trials" / name) for name in ("drawing", "serp")]

    todo = [*jobs(tmp_path / "there"), job(bad, "mrp", tmp_path / "bad", seed=1)]
    errors = run(todo, 2)
    assert {name for name, error in errors.items() if error} == {"bad"}
    assert "cable cut" in (errors["bad"] or "")
    assert set(run(jobs(tmp_path / "here"), 1).values()) == {None}
    assert everything(tmp_path / "there") == everything(tmp_path / "here")
    dead = [job(deadly, "dqn", tmp_path / f"dead{seed}", seed=seed) for seed in (1, 2)]
    errors = run(dead, 2)
    assert "its worker was lost" in (errors["dead1"] or "")
    alive = [job(good, "dqn", tmp_path / f"dead{seed}", seed=seed) for seed in (1, 2)]
    assert set(run(alive, 1).values()) == {None}
    assert not Path("planted").exists() and "PYTHONSAFEPATH" not in os.environ


def test_when_the_user_stops_no_more_trials_begin(tmp_path):
    todo = [job(walk(tmp_path), "dqn", tmp_path / str(seed), seed=seed) for seed in range(3)]
    stopping = Stopping()
    stopping.hear(signal.SIGTERM, None)
    assert run(todo, 1, stopping) == run(todo, 2, stopping) == {}


def test_what_cannot_be_sent_runs_in_this_process_and_a_bug_keeps_its_traceback(
    tmp_path, monkeypatch
):
    def fails(*arguments):
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr("serp.runs.comparison.pool.run_trial", fails)
    task = walk(tmp_path, ground=lambda seen: {"x": seen[0]})
    lines = []
    todo = [job(task, "dqn", tmp_path / str(seed), seed=seed) for seed in (0, 1)]
    ends = list(run_jobs(todo, TrialsRequest(jobs=2), Stopping(), lines.append))
    assert "one after another: the task has functions that cannot be imported" in lines[0]
    assert all("in fails" in (end.error or "") and "a bug" in (end.error or "") for end in ends)
