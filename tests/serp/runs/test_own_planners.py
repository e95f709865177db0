"""Planners of a task's own, functions and other domain files, one at a time or several at once."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from serp.agent.agent import Agent
from serp.agent.evidence import Lead
from serp.errors import RunError, SerpError, SettingsError, TaskError
from serp.model.transition_model import Vector
from serp.planning.lookahead import Lookahead
from serp.runs.diagnosis.diagnosis import read_recorded
from serp.runs.run import Run, load_run
from serp.runs.train import plan_and_learn
from serp.settings import resolve
from serp.tasks.task import Task
from tests.serp.runs.runs import everything, resume, without_pictures
from tests.serp.sample_tasks import CORRIDOR, corridor


def with_planners(folder: Path, **more: Any) -> Task:
    """The corridor with a planner that walks right, and a file that believes the goal is left."""
    other = folder / "mistaken.pddl"
    other.write_text(CORRIDOR.replace("increase (reward) 5", "increase (reward) -9"))
    planners = {"rightwards": lambda state: "right", "mistaken": other, **more}
    return corridor(folder, planners=planners)


@without_pictures()
def train(task: Task, out: Path, planner: str, episodes: int, **settings: Any) -> Run:
    chosen = {"planner": {"name": planner, "depth": 2}, **settings}
    return plan_and_learn(task, settings=chosen, episodes=episodes, seed=3, out=out, quiet=True)


def test_the_better_planner_is_found_and_a_resumed_run_equals_an_uninterrupted_one(
    tmp_path: Path,
) -> None:
    task, names = with_planners(tmp_path), "mistaken+rightwards+far-sight"
    leads = {"learner": {"learning_starts": 10_000}}  # planners alone lead
    run = train(task, tmp_path / "whole", names, 30, **leads)
    evidence = run.summary["evidence"]
    assert set(evidence["planners"]) == {"mistaken", "rightwards", "far-sight"}
    assert "mistaken" not in run.summary["trained_policy"]
    assert evidence["planners"]["mistaken"]["mean"] < evidence["planner"]["mean"]
    assert sum(worth["episodes"] for worth in evidence["planners"].values()) == 30
    train(task, tmp_path / "half", names, 15, **leads)
    (tmp_path / "mistaken.pddl").unlink()  # the run has its own copy
    resume(task, tmp_path / "half", episodes=30)
    assert everything(tmp_path / "half") == everything(tmp_path / "whole")
    assert load_run(tmp_path / "half", task).evaluate("planner", episodes=1, quiet=True).returns
    copy = tmp_path / "half" / "planner-1.pddl"
    copy.write_text(copy.read_text().replace("-9", "9"))
    for use in (lambda: resume(task, copy.parent, episodes=31), lambda: read_recorded(copy.parent)):
        with pytest.raises(
            RunError, match=r"planner-1\.pddl of the run was changed since it began"
        ):
            use()


def test_each_planner_foresees_the_environments_that_it_leads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    foreseen: list[list[float]] = []

    def note(planner: Lookahead, states: Sequence[Vector]) -> AbstractContextManager[None]:
        foreseen.append([float(state[0]) for state in states])
        return nullcontext()

    monkeypatch.setattr(Lookahead, "prefetch", note)
    task = with_planners(tmp_path)
    changes = {"planner": {"name": "lookahead+rightwards+far-sight"}, "training": {"num_envs": 6}}
    with task.bind() as bound:
        agent = Agent(bound, resolve("default", task.settings, changes), 0)
        agent.strategy._leads = [Lead(k % 3, k > 3) for k in range(6)]  # type: ignore[attr-defined]
        states = {lane: np.array([lane + 0.5]) for lane in range(6)}
        with agent.arbiter.prefetch(states):
            pass
    assert foreseen == [[0.5, 3.5], [2.5, 5.5]]


@pytest.mark.parametrize(
    ("planner", "failure", "said"),
    [
        ("up-and-away", TaskError, "planner `up-and-away` advises 'up': unknown action `up`"),
        ("blind", TaskError, "planner `blind`: KeyError: 'y'"),
        ("rightward", SettingsError, "no planner `rightward`; did you mean `rightwards`"),
        ("foreign", TaskError, "planner `foreign`: its file has the fluent `y`, which the task's"),
        ("rightwards+rightwards", SettingsError, "`rightwards` is named twice"),
        ("rightwards+", SettingsError, "there is no planner ``"),
    ],
)
def test_a_planner_that_cannot_be_used_is_refused(
    tmp_path: Path, planner: str, failure: type[SerpError], said: str
) -> None:
    foreign = tmp_path / "foreign.pddl"
    foreign.write_text(CORRIDOR.replace("(x)", "(y)"))
    task = with_planners(
        tmp_path, foreign=foreign, blind=lambda state: state["y"], **{"up-and-away": lambda _: "up"}
    )
    with pytest.raises(failure, match=said):
        train(task, tmp_path / "run", planner, 2)


def test_several_planners_need_a_strategy_that_chooses(tmp_path: Path) -> None:
    mixture = {"guide": {"strategy": "mixture"}}
    with pytest.raises(SettingsError, match="`mixture` does not choose .* guide.strategy=evidence"):
        train(with_planners(tmp_path), tmp_path / "run", "rightwards+mistaken", 2, **mixture)
