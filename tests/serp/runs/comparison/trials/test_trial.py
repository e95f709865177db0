"""One trial: its budget, its evaluations, and that one does not hang on the other."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from serp.agent.agent import Agent
from serp.errors import EnvironmentFailure, Notice, RunError, SettingsError
from serp.runs.comparison.trial import Measured
from serp.runs.precompile import precompile
from tests.serp.runs.comparison.contest import (
    GUIDED,
    OWN,
    PROTOCOL,
    Walk,
    episodes_of,
    measured,
    walk,
)
from tests.serp.sample_tasks import CableCut


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Measured]:
    """Trials that several tests look at."""
    folder = tmp_path_factory.mktemp("trials")

    @functools.cache
    def get(algorithm: str, seed: int = 0) -> Measured:
        return measured(folder, algorithm, seed=seed)

    return get


Once = Callable[..., Measured]


def found(measured: Measured) -> Any:
    """What was found, but for the time it took."""
    return episodes_of(measured), measured.evaluations, measured.characteristics


def test_a_step_that_hangs_is_a_notice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Slow(Walk):
        def step(self, action: int) -> Any:
            if self.made == 4:
                time.sleep(0.2)
            return super().step(action)

    monkeypatch.setattr("serp.runs.comparison.trial.SLOW_STEP_SECONDS", 0.05)
    with pytest.warns(Notice, match=r"0.05 s: step with action .*, env step 5\. "):
        measured(tmp_path, "mrp", task=walk(tmp_path, Slow))


@pytest.mark.parametrize("algorithm", OWN)
def test_equal_seeds_give_equal_records_and_others_give_others(
    tmp_path: Path, algorithm: str, once: Once
) -> None:
    one, other = once(algorithm, 1), once(algorithm, 2)
    same = measured(tmp_path, algorithm, seed=1)
    assert found(one) == found(same)
    assert found(one)[0] != found(other)[0]


@pytest.mark.parametrize("algorithm", [*OWN, "drawing"])
def test_evaluations_change_nothing_in_training(
    tmp_path: Path, algorithm: str, external: None, once: Once
) -> None:
    often = PROTOCOL.model_copy(
        update={"evaluate_every": 7, "evaluation_episodes": 5, "evaluation_seed": 1}
    )
    runs = [measured(tmp_path, algorithm, protocol=often), once(algorithm)]
    assert episodes_of(runs[0]) == episodes_of(runs[1])
    assert len(runs[0].evaluations) > len(runs[1].evaluations) or algorithm == "mrp"


@pytest.mark.parametrize("algorithm", [*OWN, "drawing", "greedy"])
def test_the_budget_is_met_exactly(tmp_path: Path, algorithm: str, external: None) -> None:
    made = 0

    class Counting(Walk):
        def step(self, action: int) -> Any:
            nonlocal made
            made += self.counted
            return super().step(action)

        def __init__(self) -> None:
            super().__init__()
            self.counted = not environments
            environments.append(self)

    environments: list[Any] = []  # the first is trained in, the others are evaluated in
    told: list[int] = []
    task = walk(tmp_path, Counting)
    result = measured(tmp_path, algorithm, task=task, on_progress=told.append)
    rows = [row for row, _ in result.log.rows]
    assert told[0] == 1 and told == sorted(told)
    assert result.log.env_steps == PROTOCOL.env_steps
    assert made == PROTOCOL.env_steps + (algorithm == "greedy")  # its last is not counted
    assert rows[-1].env_steps == sum(row.length for row in rows) <= PROTOCOL.env_steps
    assert [row.env_steps for row in rows] == sorted({row.env_steps for row in rows})
    assert [row.episode for row in rows] == list(range(1, len(rows) + 1))


@pytest.mark.parametrize("algorithm", [*OWN, "drawing"])
def test_what_is_evaluated_when(algorithm: str, external: None, once: Once) -> None:
    rows = once(algorithm).evaluations
    played: dict[tuple[int, str], list[int]] = {}
    for row in rows:
        played.setdefault((row.env_steps, row.policy), []).append(row.episode)
    some, all_ = [1, 2, 3], [1, 2, 3, 4]
    if algorithm == "mrp":
        assert played == {(130, "planner"): all_}
    else:
        assert played == {
            (50, "learner"): some,
            (100, "learner"): some,
            (130, "learner"): all_,
            (130, "vetoed"): all_,
        }
    vetoed = [row for row in rows if row.policy in ("vetoed", "planner")]
    assert sum(row.unsafe for row in vetoed) == 0
    if algorithm == "drawing":  # before it has learned it waits, and walks to the goal after that
        assert {row.outcome for row in rows if row.env_steps < 130} == {""}
        assert {row.outcome for row in rows if row.env_steps == 130} == {"goal"}


def test_who_leads_after_training_is_kept_of_those_that_plan_and_learn(once: Once) -> None:
    leads = {name: once(name).lead for name in OWN}
    assert {name for name, lead in leads.items() if lead is not None} == set(GUIDED)
    assert leads["serp"] is not None and leads["serp"]["evidence"]["planner"]["episodes"] > 0
    assert leads["serp-paper"] is not None and leads["serp-paper"]["evidence"] is None


def test_the_planner_alone_is_the_planner_whatever_is_set(tmp_path: Path) -> None:
    changes: Any = {
        "arbiter": {"rho": 1.0},
        "guide": {"strategy": "evidence"},
        "training": {"random_steps": 50},
        "learner": {"members": 3},
    }
    plain, changed = measured(tmp_path, "mrp"), measured(tmp_path, "mrp", changes=changes)
    assert found(changed) == found(plain)


def test_settings_of_the_user_reach_the_learner_and_the_algorithms_own_stand(
    tmp_path: Path,
) -> None:
    paths = [
        measured(tmp_path, "dqn", changes={"learner": {"epsilon_end": epsilon}})
        for epsilon in (0.0, 1.0)
    ]
    assert episodes_of(paths[0]) != episodes_of(paths[1])
    with pytest.raises(SettingsError, match="did you mean `learner`"):
        measured(tmp_path, "dqn", changes={"lerner": {"members": 1}})


def test_counters_are_the_environments(tmp_path: Path) -> None:
    slips = [counts for _, counts in measured(tmp_path).log.rows]
    assert all(len(counts) == 1 for counts in slips)
    assert sum(counts[0] for counts in slips) > 0


@pytest.mark.parametrize(
    ("algorithm", "message"),
    [
        ("lazy", "`lazy` made 120 env steps of 130 and ended"),
        ("faulty", "`faulty` failed: ValueError: expected scalar type Float"),
    ],
)
def test_what_goes_wrong_in_an_external_one_is_told(
    tmp_path: Path, algorithm: str, message: str, external: None
) -> None:
    with pytest.raises(RunError, match=message):
        measured(tmp_path, algorithm)


def test_what_goes_wrong_in_the_environment_is_told_and_environments_are_closed(
    tmp_path: Path,
) -> None:
    made, closed = [], []

    class Closing(CableCut):
        def close(self) -> None:
            closed.append(self)
            super().close()

    def make() -> Closing:
        made.append(Closing(Walk(), 20))
        return made[-1]

    with pytest.raises(EnvironmentFailure, match="cable cut"):
        measured(tmp_path, task=walk(tmp_path, make))
    assert len(made) > 1
    assert set(map(id, made)) == set(map(id, closed))


def test_a_training_begins_when_what_it_calls_is_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seconds = []

    def rehearsing(agent: Agent) -> None:
        begin = time.perf_counter()
        precompile(agent)
        time.sleep(0.2)
        seconds.append(time.perf_counter() - begin)

    monkeypatch.setattr("serp.runs.trainer.precompile", rehearsing)
    begin = time.perf_counter()
    found = measured(tmp_path, "dqn").seconds
    (took,) = seconds
    assert min(found.values()) > 0
    assert took + sum(found.values()) <= time.perf_counter() - begin
