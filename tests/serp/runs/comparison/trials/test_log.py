"""What is written down of a training: sums over the steps of each episode."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from serp.agent.agent import Agent
from serp.agent.arbiter import Arbiter
from serp.agent.decision import Actor, Decision, Reason
from serp.agent.step_record import EpisodeTotals, StepRecord
from serp.errors import TaskError
from serp.learning.dqn import Proposal
from serp.runs.comparison.trial import Log
from serp.settings import resolve
from tests.serp.agent.records import step_record
from tests.serp.runs.comparison.contest import walk


def arbiter(folder: Path) -> Arbiter:
    task = walk(folder).bind()
    return Agent(task, resolve("default", task.task.settings), 0).arbiter


def tell(log: Log, steps: Iterable[StepRecord]) -> None:
    """Let a log write steps down, added up by episode."""
    totals = EpisodeTotals()
    for step in steps:
        counted = step._replace(number=totals.length + 1, episode=totals)
        totals.add(counted)
        log.step(counted)
        if step.last:
            totals = EpisodeTotals()


def stepped(
    decision: Decision, reward: float = 1.0, *, last: bool = False, **info: Any
) -> StepRecord:
    return step_record(decision, env_reward=reward, reward=10 * reward, terminated=last, info=info)


def decisions(folder: Path) -> dict[str, Decision]:
    """A decision of each kind."""
    guard = arbiter(folder)
    middle, brink = np.array([0.0]), np.array([-2.0])
    right, left = Proposal(1, False, None), Proposal(0, False, None)
    found = {
        "planner": guard.plan(middle),
        "learner": guard.judge_proposal(middle, right),
        "vetoed": guard.judge_proposal(brink, left),
        "unsafe": guard.judge_proposal(middle, right)._replace(
            action=0, unsafe=True, forecast=guard.forecast(brink)
        ),
    }
    assert found["vetoed"].reason is Reason.UNSAFE
    assert found["vetoed"].executed_by is Actor.PLANNER
    return found


@pytest.mark.parametrize("slips", [2, np.float32(2)])
def test_counters_may_be_any_numbers(tmp_path: Path, slips: Any) -> None:
    log, done = Log(("slips",)), decisions(tmp_path)["planner"]
    tell(log, [stepped(done, last=True, slips=slips)])
    assert {counted for _, counted in log.rows} == {(float(np.sum(slips)),)}


@pytest.mark.parametrize("slips", ["2", float("nan"), np.zeros(2)])
def test_a_counter_that_is_no_number_is_named(tmp_path: Path, slips: Any) -> None:
    log, done = Log(("slips",)), decisions(tmp_path)["planner"]
    with pytest.raises(TaskError, match="the task counts `slips`, but .*a finite number is wanted"):
        tell(log, [stepped(done, last=True, slips=slips)])


def test_an_episode_is_the_sum_of_its_steps(tmp_path: Path) -> None:
    now, seen = 100.0, decisions(tmp_path)
    log = Log(["slips"], lambda: now)

    def steps() -> Iterator[StepRecord]:
        nonlocal now
        for k, name in enumerate(("planner", "learner", "vetoed", "unsafe")):
            now += 2.0
            yield stepped(seen[name], k + 1.0, last=k == 3, slips=7 + k, outcome="pit")._replace(
                unsafe_observed=k > 1
            )
        with log.paused():
            now += 50.0
        now += 1.0
        yield stepped(seen["learner"], last=True)

    tell(log, steps())
    (first, slips), (second, none) = log.rows
    assert first == (1, 4, 10.0, 100.0, 4, True, "pit", 1, 1, 2, 1, 2, 8.0)
    assert slips == (10.0,)
    assert (second.episode, second.env_steps, second.length) == (2, 5, 1)
    assert (second.return_, second.outcome) == (1.0, "")
    assert second.seconds == log.seconds == 9.0
    assert none == (0.0,)
    assert (log.env_steps, log.pauses) == (5, 50.0)


def test_unsafe_counts_as_avoidable_while_there_was_something_else(tmp_path: Path) -> None:
    made = decisions(tmp_path)["unsafe"]
    assert made.avoidable_unsafe
    only = made.forecast._replace(flags=np.array([made.forecast.flags[0]] * 3 + [0]))
    lost = made._replace(forecast=only)
    assert lost.avoidable_unsafe  # `dance` is not predicted
    assert not lost._replace(admissible=np.zeros(4, bool)).avoidable_unsafe  # and is refused
    known = only._replace(flags=only.flags[:3], ground=only.ground[:3])
    assert not lost._replace(forecast=known, admissible=np.ones(3, bool)).avoidable_unsafe
    assert not decisions(tmp_path)["learner"].avoidable_unsafe  # nothing unsafe was executed


def test_an_episode_that_is_cut_short_ends_too_and_one_that_runs_is_not_written(
    tmp_path: Path,
) -> None:
    made = decisions(tmp_path)["learner"]
    log = Log(())
    tell(log, [stepped(made)._replace(truncated=True)])
    tell(log, [stepped(made)])
    ((row, _),) = log.rows
    assert not row.terminated
    assert log.env_steps == 2
