"""Trials in this process and in others: the same records, and nobody dies for another."""

from __future__ import annotations

import os
import pickle
from pathlib import Path
from typing import Any

import pytest

from serp.comparison.algorithms import find_algorithm
from serp.comparison.trial_files import is_complete
from serp.comparison.trial_records import Trial
from serp.comparison.workers import Ended, Job, portable, run_here, run_in_processes
from serp.tasks.task import Task
from tests.serp.comparison.contest import PROTOCOL, Deadly, Pothole, Signalled, everything, walk


def job(folder: Path, task: Task, algorithm: str, seed: int) -> Job:
    folder.mkdir(exist_ok=True)
    trial = Trial(algorithm, "walk", seed)
    found = find_algorithm(algorithm)
    return Job(folder, trial, found, task, found.settings(task, {}), PROTOCOL, {})


def test_processes_find_what_this_one_finds_and_nobody_dies_for_another(
    tmp_path: Path, external: None
) -> None:
    """External algorithms too, trials that fail, processes that die, and signals."""
    good, bad, deadly = walk(tmp_path), walk(tmp_path, Pothole), walk(tmp_path, Deadly)
    todo = [
        job(tmp_path / "there", good, "drawing", 0),
        job(tmp_path / "there", bad, "mrp", 1),
        job(tmp_path / "there", bad, "serp", 0),
        job(tmp_path / "there", walk(tmp_path, Signalled), "serp", 7),
        job(tmp_path / "there", deadly, "dqn", 1),  # kills its process
        job(tmp_path / "there", deadly, "dqn", 0),
    ]
    assert portable(todo)
    told: set[Trial] = set()

    def stopped() -> bool:
        return len(ended) == len(todo)

    never = job(tmp_path / "there", good, "dqn", 9)  # the user has stopped before it begins
    ended: list[Ended] = []
    ends = run_in_processes([*todo, never], 1, lambda trial, n: told.add(trial), stopped)
    for end in ends:
        ended.append(end)
    assert [end.trial for end in ended] == [one.trial for one in todo]
    errors = {end.trial: end.error or "" for end in ended}
    for trial, error in errors.items():
        assert is_complete(tmp_path / "there", trial) == (error == "") == (trial.seed != 1)
    assert "ConnectionError: cable cut" in errors[Trial("mrp", "walk", 1)]
    assert "its process died" in errors[Trial("dqn", "walk", 1)]
    # What the process that died had to tell may be lost with it.
    assert told | {Trial("dqn", "walk", 1)} == {one.trial for one in todo}
    alone = [
        job(tmp_path / "here", good, name, seed)
        for name, seed in (("dqn", 0), ("drawing", 0), ("serp", 0), ("serp", 7))
    ]
    ended = list(run_here(alone, lambda trial, steps: None))
    assert ended == [Ended(one.trial, None) for one in alone]
    assert everything(tmp_path / "there") == everything(tmp_path / "here")


def test_when_the_user_stops_what_runs_comes_to_its_end_and_no_more_begins(
    tmp_path: Path,
) -> None:
    todo = [job(tmp_path / "c", walk(tmp_path), "dqn", seed) for seed in range(3)]
    pressed: list[int] = []
    ended = run_here(todo, lambda trial, n: pressed.append(n), lambda: bool(pressed))
    assert list(ended) == [Ended(Trial("dqn", "walk", 0), None)]
    assert len(everything(tmp_path / "c")) == 1
    assert list(run_in_processes(todo, 2, lambda trial, steps: None, lambda: True)) == []


def test_functions_that_cannot_be_imported_are_noticed(tmp_path: Path) -> None:
    class Unpicklable:
        def __reduce__(self) -> Any:
            raise RuntimeError("not me")

    good = job(tmp_path, walk(tmp_path), "serp", 0)
    assert portable([good])
    here_only = walk(tmp_path, ground=lambda seen: {"x": seen[0]})
    assert not portable([good, job(tmp_path, here_only, "serp", 0)])
    odd: Any = Unpicklable()
    assert not portable([job(tmp_path, walk(tmp_path, description=odd), "serp", 0)])
    assert pickle.loads(pickle.dumps(good)) == good


def test_a_bug_keeps_its_traceback(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*arguments: Any) -> Any:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr("serp.comparison.workers.run_trial", fails)
    with pytest.raises(ZeroDivisionError, match="a bug"):
        list(run_here([job(tmp_path, walk(tmp_path), "serp", 0)], lambda trial, steps: None))
    assert os.listdir(tmp_path) == ["corridor.pddl"]
