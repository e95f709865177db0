"""A comparison before it runs: its trials, what they are made of, the command for all of it."""

from __future__ import annotations

import dataclasses
import pickle
import shlex
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.errors import RunError, SettingsError
from serp.model.reachability import MAX_GROUND_SCHEMAS
from serp.runs.comparison.algorithms import find_algorithm
from serp.runs.comparison.plan import ComparisonPlan, ComparisonProtocol, Trial
from serp.runs.comparison.request import (
    PreparedComparison,
    named_algorithms,
    rerun_command,
    trials_of,
)
from serp.runs.comparison.trial_files import write_trial
from tests.serp.runs.comparison.contest import PROTOCOL, measured, walk
from tests.serp.sample_tasks import CORRIDOR


def prepared(folder: Path, **changes: Any) -> PreparedComparison:
    """A comparison of `serp` with `dqn`; `changes` are of its attributes and those of its plan."""
    found = changes.pop("algorithms", None) or named_algorithms(["serp", "dqn"], {})
    tasks = changes.pop("tasks", {"walk": walk(folder)})
    plan = ComparisonPlan(
        task="walk",
        variants=tuple(tasks),
        algorithms={name: {} for name in found},
        trials=tuple(trials_of(found.values(), ["walk"], [1, 0])),
        protocol=PROTOCOL,
        changes={},
        threshold=None,
        max_ground_schemas=MAX_GROUND_SCHEMAS,
    )
    (folder / "c").mkdir(exist_ok=True)
    return PreparedComparison(folder / "c", plan.model_copy(update=changes), tasks, found)


@given(st.integers(1, 200), st.integers(1, 300))
def test_evaluations_are_due_at_equal_distances_and_at_the_end(budget: int, every: int) -> None:
    protocol = ComparisonProtocol(env_steps=budget, evaluate_every=every)
    due = [k for k in range(1, budget + 1) if protocol.due(k)]
    assert due == sorted({*range(every, budget + 1, every), budget})


def test_what_uses_no_model_runs_on_the_first_domain_file_alone(external: None) -> None:
    algorithms = named_algorithms(["serp", "mrp", "dqn", "drawing"], {})
    trials = trials_of(algorithms.values(), ["walk", "bad"], [4, 7])
    assert len(trials) == len(set(trials)) == 2 * (2 * 2 + 2)
    for trial in trials:
        assert trial.variant == "walk" or trial.algorithm in ("serp", "mrp")
    assert {trial.seed for trial in trials} == {4, 7}


def test_what_is_missing_comes_seed_by_seed_and_of_the_same_making(tmp_path: Path) -> None:
    made, done = prepared(tmp_path), Trial("dqn", "walk", 0)
    assert [trial.seed for trial in made.missing()] == [0, 0, 1, 1]
    write_trial(made.folder, done, measured(tmp_path), {"made_of": made.made_of(done)})
    assert made.missing() == [
        Trial("serp", "walk", 0),
        *(Trial(n, "walk", 1) for n in ("serp", "dqn")),
    ]
    other = tmp_path / "other.pddl"
    other.write_text(CORRIDOR.replace("decrease (reward) 5", "decrease (reward) 6"))
    with_planner = walk(tmp_path, planners={"a": other})
    changed = dataclasses.replace(made.algorithms["dqn"], kind="guided")
    for changes, message in (
        ({"changes": {"learner": {"members": 1}}}, "other settings"),
        ({"protocol": PROTOCOL.model_copy(update={"env_steps": 99})}, "another budget"),
        ({"tasks": {"walk": walk(tmp_path, domain=other)}}, "another domain file"),
        ({"tasks": {"walk": with_planner}}, "another domain file"),
        ({"algorithms": {**made.algorithms, "dqn": changed}}, "another algorithm"),
    ):
        with pytest.raises(RunError, match=f"dqn on walk, seed 0 was made with {message}"):
            prepared(tmp_path, **changes).missing()
    sent = pickle.loads(pickle.dumps(prepared(tmp_path, tasks={"walk": with_planner}).job(done)))
    assert sent.task.planners["a"].source.text == other.read_text()  # not only its path


def test_names_with_a_colon_are_made_of_what_they_change() -> None:
    found = named_algorithms(["serp", "serp:a"], {"serp:a": {"learner": {"members": 1}}})
    assert found["serp"] is find_algorithm("serp")
    assert found["serp:a"].changes["learner"] == {"members": 1}
    with pytest.raises(SettingsError, match="`serp:b`: say in `changed`"):
        named_algorithms(["serp:b"], {})
    with pytest.raises(SettingsError, match="no algorithm `srep`"):
        named_algorithms(["srep:a"], {"srep:a": {}})


@pytest.mark.parametrize(("seeds", "text"), [([1, 0], "0-1"), ([4], "4-4"), ([1, 7], "1,7")])
def test_the_command_names_all_that_is_no_default(
    tmp_path: Path, seeds: list[int], text: str
) -> None:
    changes = {"arbiter": {"r_min": None}, "learner": {"hidden": (8, 8), "members": 1}}
    trials = tuple(Trial("serp", "walk", seed) for seed in seeds)
    made = prepared(
        tmp_path, changes=changes, trials=trials, threshold=2.5, max_ground_schemas=70_000
    )
    command = rerun_command(made, None)
    for part in (
        f"--seeds {text} ", "--domain domains/walk.pddl", "--task FILE.py:FUNCTION",
        "--algorithms serp,dqn", "--env-steps 130", "--evaluate-every 50", "--threshold 2.5",
        "--evaluation-episodes 3", "--final-episodes 4", "--max-ground-schemas 70000",
        "--set arbiter.r_min=null", "--set learner.members=1",
    ):  # fmt: skip
        assert part in command
    assert "learner.hidden=[8, 8]" in shlex.split(command)
    assert "--threshold" not in rerun_command(made, 2.5)
