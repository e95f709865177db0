"""A plan: its trials, and what each is made of."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from serp.comparison.algorithms import find_algorithm
from serp.comparison.plan import ComparisonPlan, named_algorithms, trials_of
from serp.comparison.trial_files import write_trial
from serp.comparison.trial_records import Trial
from serp.errors import RunError, SettingsError
from serp.model.facts import MAX_GROUND_SCHEMAS
from serp.tasks.task import Task
from tests.serp.comparison.contest import PROTOCOL, measured, walk
from tests.serp.sample_tasks import CORRIDOR


def plan(folder: Path, *, task: Task | None = None, **changes: Any) -> ComparisonPlan:
    algorithms = named_algorithms(["serp", "dqn"], {})
    values: dict[str, Any] = {
        "folder": folder / "c",
        "task": "walk",
        "variants": {"walk": task or walk(folder)},
        "algorithms": algorithms,
        "trials": trials_of(algorithms, ["walk"], [1, 0]),
        "protocol": PROTOCOL,
        "changes": {},
        "threshold": None,
        "max_ground_schemas": MAX_GROUND_SCHEMAS,
    }
    (folder / "c").mkdir(exist_ok=True)
    return ComparisonPlan(**{**values, **changes})


def complete(plan: ComparisonPlan, trial: Trial, folder: Path) -> None:
    about = {"made_of": plan.made_of(trial)}
    write_trial(plan.folder, trial, measured(folder), about, ("slips",))


def test_what_uses_no_model_runs_on_the_first_domain_file_alone(external: None) -> None:
    algorithms = named_algorithms(["serp", "mrp", "dqn", "drawing"], {})
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
        ({"protocol": dataclasses.replace(PROTOCOL, env_steps=99)}, "another budget"),
        ({"variants": {"walk": walk(tmp_path, domain=other)}}, "another domain file"),
        ({"algorithms": {**algorithms, "dqn": changed}}, "another algorithm"),
    ):
        with pytest.raises(RunError, match=f"dqn on walk, seed 0, was made with {message}"):
            plan(tmp_path, **changes).missing()
    assert done not in plan(tmp_path).missing()


def test_names_with_a_colon_are_made_of_what_they_change() -> None:
    found = named_algorithms(
        ["serp", "serp:a"], {"serp:a": {"learner": {"members": 1}}, "serp": {}}
    )
    assert found["serp"] is find_algorithm("serp")
    assert found["serp:a"].changes["learner"] == {"members": 1}
    with pytest.raises(SettingsError, match="`serp:b`: say in `changed`"):
        named_algorithms(["serp:b"], {})
    with pytest.raises(SettingsError, match="no algorithm `srep`"):
        named_algorithms(["srep:a"], {"srep:a": {}})
