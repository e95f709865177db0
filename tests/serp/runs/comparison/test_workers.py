"""Trials in this process and in others: the same records, and nobody dies for another."""

from __future__ import annotations

import os
import pickle
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from serp.errors import RunError
from serp.runs.comparison.algorithms import find_algorithm
from serp.runs.comparison.plan import Trial
from serp.runs.comparison.workers import (
    Ended,
    Job,
    Pool,
    at_once,
    open_pool,
    portable,
    run_here,
    run_in_executor,
    runs_here,
)
from serp.tasks.task import Task
from tests.serp.runs.comparison.contest import (
    PROTOCOL,
    Deadly,
    Pothole,
    Signalled,
    episodes_of,
    walk,
)


def job(task: Task, algorithm: str, seed: int) -> Job:
    trial = Trial(algorithm, "walk", seed)
    found = find_algorithm(algorithm)
    return Job(trial, found, task, found.settings(task, {}), PROTOCOL)


def silent(trial: Trial, env_steps: int) -> None:
    """Nobody looks."""


def found_in(ended: list[Ended]) -> dict[Trial, Any]:
    """What the complete trials have found, but for the time they took."""
    return {
        end.trial: (episodes_of(end.measured), end.measured.evaluations)
        for end in ended
        if end.measured is not None
    }


def test_processes_find_what_this_one_finds_and_nobody_dies_for_another(
    tmp_path: Path, external: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """External algorithms too, trials that fail, processes that die, and signals."""
    monkeypatch.setattr("serp.runs.comparison.workers._RETRIES", 0)
    good, bad, deadly = walk(tmp_path), walk(tmp_path, Pothole), walk(tmp_path, Deadly)
    todo = [
        job(good, "drawing", 0),
        job(bad, "mrp", 1),
        job(bad, "serp", 0),
        job(walk(tmp_path, Signalled), "serp", 7),
        job(deadly, "dqn", 1),  # kills its process
        job(deadly, "dqn", 0),
    ]
    assert portable(todo)
    told: set[Trial] = set()

    def stopped() -> bool:
        return len(ended) == len(todo)

    never = job(good, "dqn", 9)  # the user has stopped before it begins
    ended: list[Ended] = []
    with open_pool("local", None, 1) as pool:
        for end in run_in_executor([*todo, never], pool, lambda trial, n: told.add(trial), stopped):
            ended.append(end)
    errors = {end.trial: end.error or "" for end in ended}
    assert set(errors) == {one.trial for one in todo}
    for trial, error in errors.items():
        assert (trial in found_in(ended)) == (error == "") == (trial.seed != 1)
    assert "ConnectionError: cable cut" in errors[Trial("mrp", "walk", 1)]
    assert "attempts: ConnectionError: the process died" in errors[Trial("dqn", "walk", 1)]
    # What the process that died had to tell may be lost with it.
    assert told | {Trial("dqn", "walk", 1)} == {one.trial for one in todo}
    alone = [
        job(good, name, seed)
        for name, seed in (("dqn", 0), ("drawing", 0), ("serp", 0), ("serp", 7))
    ]
    here = list(run_here(alone, silent))
    assert [end.trial for end in here] == [one.trial for one in alone]
    assert found_in(ended) == found_in(here)


PLANTED = """
with open("planted", "a") as file:
    file.write(__name__)
"""


def test_nothing_of_the_working_folder_is_run_in_another_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    todo = [job(walk(tmp_path), "mrp", 0)]
    monkeypatch.chdir(tmp_path)
    for name in ("pickle", "random", "socket", "numpy", "torch"):
        Path(f"{name}.py").write_text(PLANTED)
    with open_pool("local", None, 1) as pool:
        (ended,) = run_in_executor(todo, pool, silent, lambda: False)
    assert not Path("planted").exists()
    assert ended.error is None
    assert "PYTHONSAFEPATH" not in os.environ


def test_when_the_user_stops_what_runs_comes_to_its_end_and_no_more_begins(
    tmp_path: Path,
) -> None:
    todo = [job(walk(tmp_path), "dqn", seed) for seed in range(3)]
    pressed: list[int] = []
    ended = run_here(todo, lambda trial, n: pressed.append(n), lambda: bool(pressed))
    assert set(found_in(list(ended))) == {Trial("dqn", "walk", 0)}


class Losing(Executor):
    """Runs at once what it is given, and loses workers: that of seed 0 once, of seed 1 always."""

    def __init__(self) -> None:
        self.begun: list[int] = []

    def submit(self, function: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        (given,) = pickle.loads(pickle.dumps(args))  # as to another machine
        self.begun.append(given.trial.seed)
        lost = {0: 1, 1: 99}.get(given.trial.seed, 0)
        future: Future[Any] = Future()
        if self.begun.count(given.trial.seed) <= lost:
            future.set_exception(ConnectionError("the node is gone"))
        else:
            future.set_result(pickle.loads(pickle.dumps(function(given, **kwargs))))
        return future


def test_a_lost_worker_costs_its_trial_only_which_is_begun_again(tmp_path: Path) -> None:
    executor = Losing()
    todo = [job(walk(tmp_path), "dqn", seed) for seed in range(4)]
    ended = list(run_in_executor(todo, Pool(executor, 2), silent, lambda: False))
    assert sorted(executor.begun) == [0, 0, 1, 1, 1, 2, 3]
    assert found_in(ended) == found_in(list(run_here([todo[0], *todo[2:]], silent)))
    (error,) = (end.error for end in ended if end.error)
    assert (
        error.startswith("its worker was lost, in each of 3 attempts: Conn")
        and "the node is gone" in error
    )
    assert list(run_in_executor(todo, Pool(executor, 2), silent, lambda: True)) == []
    gone = ThreadPoolExecutor()
    gone.shutdown()
    with pytest.raises(RunError, match="takes no more trials .RuntimeError: cannot schedule new"):
        list(run_in_executor(todo, Pool(gone, 2), silent, lambda: False))


def test_one_job_at_a_time_runs_in_this_process_and_a_cluster_says_how_many(tmp_path: Path) -> None:
    one, two = ([job(walk(tmp_path), "dqn", seed) for seed in range(n)] for n in (1, 2))
    assert at_once("local", 9, 1) == at_once("local", None, 1) == at_once("local", 1, 2) == 1
    assert runs_here("local", one, 1) and runs_here("local", two, 1)
    assert (at_once("local", 9, 2), at_once("ray", None, 2), at_once("ray", 1, 2)) == (2, 0, 1)
    assert not runs_here("local", two, 2) and not runs_here("ray", one, 1)
    assert runs_here(
        "local", [job(walk(tmp_path, ground=lambda seen: {"x": seen[0]}), "dqn", 0)] * 2, 2
    )


def test_functions_that_cannot_be_imported_are_noticed(tmp_path: Path) -> None:
    class Unpicklable:
        def __reduce__(self) -> Any:
            raise RuntimeError("not me")

    good = job(walk(tmp_path), "serp", 0)
    assert portable([good])
    here_only = walk(tmp_path, ground=lambda seen: {"x": seen[0]})
    assert not portable([good, job(here_only, "serp", 0)])
    odd: Any = Unpicklable()
    assert not portable([job(walk(tmp_path, description=odd), "serp", 0)])
    assert pickle.loads(pickle.dumps(good)) == good


def test_a_bug_keeps_its_traceback(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*arguments: Any) -> Any:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr("serp.runs.comparison.workers.run_trial", fails)
    todo = [job(walk(tmp_path), "serp", 2)]
    with pytest.raises(ZeroDivisionError, match="a bug"):
        list(run_here(todo, silent))
    with pytest.raises(ZeroDivisionError) as found:
        list(run_in_executor(todo, Pool(Losing(), 1), silent, lambda: False))
    assert "in fails" in "".join(found.value.__notes__)
    assert os.listdir(tmp_path) == ["corridor.pddl"]
