"""A plan: its trials, what each is made of, and the domain files as they are kept."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from serp.compare.algorithms import ablation, find_algorithm
from serp.compare.plan import ComparisonPlan, keep_domain, named, read_plan, trials_of
from serp.compare.records import Trial
from serp.compare.storage import write_trial
from serp.errors import RunError, SettingsError
from serp.tasks.task import Task
from tests.serp.compare.contest import CONDITIONS, measured, walk
from tests.serp.sample_tasks import CORRIDOR

PROBLEM = "(define (problem there) (:domain corridor) (:init (= (x) 0)) (:goal (and)))\n"


def plan(folder: Path, *, task: Task | None = None, **changes: Any) -> ComparisonPlan:
    algorithms = named(["serp", "dqn"], {})
    values: dict[str, Any] = {
        "folder": folder / "c",
        "name": "walk",
        "variants": {"walk": task or walk(folder)},
        "algorithms": algorithms,
        "trials": trials_of(algorithms, ["walk"], [1, 0]),
        "conditions": CONDITIONS,
        "changes": {},
        "threshold": None,
    }
    (folder / "c").mkdir(exist_ok=True)
    return ComparisonPlan(**{**values, **changes})


def complete(plan: ComparisonPlan, trial: Trial, folder: Path) -> None:
    about = {"made_of": plan.made_of(trial)}
    write_trial(plan.folder, trial, measured(folder), about, ("slips",))


def test_what_uses_no_model_runs_on_the_first_domain_file_alone(guests: None) -> None:
    algorithms = named(["serp", "mrp", "dqn", "drawing"], {})
    trials = trials_of(algorithms, ["walk", "bad"], [4, 7])
    assert len(trials) == len(set(trials)) == 2 * (2 * 2 + 2)
    for trial in trials:
        assert trial.variant == "walk" or trial.algorithm in ("serp", "mrp")
    assert {trial.seed for trial in trials} == {4, 7}


def test_what_is_missing_comes_seed_by_seed(tmp_path: Path) -> None:
    made = plan(tmp_path)
    assert [t.seed for t in made.missing()] == [0, 0, 1, 1]
    done = Trial("dqn", "walk", 0)
    complete(made, done, tmp_path)
    assert made.missing() == [Trial("serp", "walk", 0), Trial("serp", "walk", 1),
                              Trial("dqn", "walk", 1)]  # fmt: skip
    assert made.seeds == [0, 1]
    assert made.base == "walk"


def test_a_trial_that_was_made_of_something_else_is_refused(tmp_path: Path) -> None:
    done = Trial("dqn", "walk", 0)
    complete(plan(tmp_path), done, tmp_path)
    other = tmp_path / "other.pddl"
    other.write_text(CORRIDOR.replace("decrease (reward) 5", "decrease (reward) 6"))
    algorithms = plan(tmp_path).algorithms
    changed = dataclasses.replace(algorithms["dqn"], kind="guided")
    for changes, message in (
        ({"changes": {"learner": {"members": 1}}}, "other settings"),
        ({"conditions": dataclasses.replace(CONDITIONS, env_steps=99)}, "another budget"),
        ({"variants": {"walk": walk(tmp_path, domain=other)}}, "another domain file"),
        ({"algorithms": {**algorithms, "dqn": changed}}, "another algorithm"),
    ):
        with pytest.raises(RunError, match=f"dqn on walk, seed 0, was made with {message}"):
            plan(tmp_path, **changes).missing()
    assert done not in plan(tmp_path).missing()


def test_a_plan_is_read_as_it_was_written(tmp_path: Path) -> None:
    changes = {"arbiter": {"exploration_slack": float("inf")}, "learner": {"hidden": (8, 8)}}
    base = find_algorithm("serp")
    other = ablation(base, "serp:x", {"arbiter": {"r_min": None, "exploration_slack": 0.5}})
    made = plan(tmp_path, changes=changes, algorithms={"serp": base, "serp:x": other})
    assert read_plan(made.folder) is None
    made.write()
    read = read_plan(made.folder)
    assert read is not None
    assert read["task"] == "walk"
    assert [Trial(*trial) for trial in read["trials"]] == list(made.trials)
    assert read["conditions"] == CONDITIONS.as_dict()
    assert list(read["algorithms"]) == ["serp", "serp:x"]
    assert read["changes"] == {
        "arbiter": {"exploration_slack": "inf"}, "learner": {"hidden": [8, 8]},
    }  # fmt: skip
    (made.folder / "plan.json").write_text("{")
    with pytest.raises(RunError, match="plan.json is damaged"):
        read_plan(made.folder)


def test_names_with_a_colon_are_made_of_what_they_change() -> None:
    found = named(["serp", "serp:a"], {"serp:a": {"learner": {"members": 1}}, "serp": {}})
    assert found["serp"] is find_algorithm("serp")
    assert found["serp:a"].changes["learner"] == {"members": 1}
    with pytest.raises(SettingsError, match="nothing is said of what `serp:b` changes"):
        named(["serp:b"], {})
    with pytest.raises(SettingsError, match="no algorithm `srep`"):
        named(["srep:a"], {"srep:a": {}})


def test_the_domain_file_is_kept_as_it_was(tmp_path: Path) -> None:
    task = walk(tmp_path)
    kept = keep_domain(tmp_path / "c", "walk", task.load(), task)
    assert Path(str(kept.domain)) == tmp_path / "c" / "domains" / "walk.pddl"
    (tmp_path / "corridor.pddl").write_text(CORRIDOR.replace("decrease (x) 1", "decrease (x) 2"))
    assert kept.load().source.text == CORRIDOR
    with pytest.raises(RunError, match="is not what the domain file `walk` says now"):
        keep_domain(tmp_path / "c", "walk", task.load(), task)
    assert kept.load().source.text == CORRIDOR


def test_a_problem_file_is_kept_with_it_and_missed_when_it_is_gone(tmp_path: Path) -> None:
    task = walk(tmp_path)
    beside = tmp_path / "corridor-problem.pddl"
    beside.write_text(PROBLEM)
    kept = keep_domain(tmp_path / "c", "walk", task.load(), task)
    assert kept.load().problem_source is not None
    again = keep_domain(tmp_path / "c", "walk", task.load(), task)
    assert again == kept
    beside.write_text(PROBLEM.replace("(= (x) 0)", "(= (x) 1)"))
    with pytest.raises(RunError, match="walk-problem.pddl is not what"):
        keep_domain(tmp_path / "c", "walk", task.load(), task)
    beside.unlink()
    with pytest.raises(RunError, match="walk-problem.pddl is a problem file"):
        keep_domain(tmp_path / "c", "walk", task.load(), task)
