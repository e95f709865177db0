"""The ladder of benchmarks: its differences pair the seeds, and its mechanisms exist."""

from typing import Any

import numpy as np
import pytest

from serp.settings import resolve
from serp.tasks.registry import task_entries
from tests.benchmarks import ladder


def row(task: str, seed: int, serp: float, without: str = "", speed: float = 100.0) -> ladder.Row:
    given: dict[str, Any] = dict.fromkeys(ladder.COLUMNS, 0)
    own = {"planner": 5.0, "learner": 5.0, "training": 5.0, "random": 0.0, "ms_per_decision": 1.0}
    own |= {"without": without, "task": task, "seed": seed, "env_steps": 2000, "serp": serp}
    return given | own | {"steps_per_cpu_second": speed}


def test_differences_are_paired_by_seed_in_per_cent_of_the_range() -> None:
    full = [row("taxi", seed, 10.0 * (seed + 1)) for seed in (0, 1)]  # the best mean is 15
    less = [row("taxi", seed, 10.0 * (seed + 1) - 3.0, "slack", 200.0) for seed in (1, 0)]
    found = ladder.compare(less, full)["taxi", 2000]
    assert found.differences["serp"].value == pytest.approx(-20.0)
    assert found.differences["serp"].half == pytest.approx(0.0)
    assert found.differences["serp"].sure and not found.differences["planner"].sure
    assert found.speed == pytest.approx(2.0) and found.seeds == 2


def test_one_seed_says_nothing_of_noise() -> None:
    alone = ladder.mean([3.0])
    assert not alone.sure and alone.text(".4g") == "3"


def test_a_mechanism_stays_for_two_unrelated_tasks_or_one_large_difference() -> None:
    tasks = ("taxi", "cliff", "soccer", "soccer-coarse")
    full = [row(task, seed, 10.0) for task in tasks for seed in (0, 1)]

    def said(**serp: float) -> str:
        worth = {"taxi": 10.0, "cliff": 10.0, "soccer": 10.0, "soccer_coarse": 10.0} | serp
        less = [
            row(task.replace("_", "-"), seed, value, "slack")
            for task, value in worth.items()
            for seed in (0, 1)
        ]
        *_, last = ladder.worths(less, full)
        return last[-1]

    assert said() == "goes"
    assert said(taxi=9.0) == "goes"
    assert said(taxi=9.0, cliff=9.0) == "stays"
    assert said(soccer=9.0, soccer_coarse=9.0) == "goes"  # variants are one task
    assert said(taxi=7.0) == "stays"


@pytest.mark.parametrize("name", ladder.WITHOUT)
def test_a_mechanism_is_switched_off_by_what_exists(name: str) -> None:
    assert resolve("default", changes=ladder.changes_of([name]))
    for each in ladder.WITHOUT[name]:
        assert isinstance(each, str) or ladder.place_of(each[0])


def test_the_landed_numbers_are_those_of_all_tasks_and_variants() -> None:
    rows = ladder.read(ladder.ROOT / "docs" / "results" / "ladder.csv")
    assert {row["task"] for row in rows} == set(ladder.named()) > set(task_entries())
    assert all(row["avoidable_unsafe"] == 0 for row in rows)
    assert all(np.isfinite(row[name]) for row in rows for name in ladder.POLICIES)
