"""The folder of a comparison: its lock, its plan, and the domain files that it keeps."""

from __future__ import annotations

from pathlib import Path

import pytest

from serp.errors import RunError
from serp.runs.comparison.folder import keep_domain, writing
from serp.runs.comparison.plan import ComparisonPlan, Trial, read_plan, write_plan
from tests.serp.runs.comparison.contest import PROTOCOL, walk
from tests.serp.sample_tasks import CORRIDOR

PROBLEM = "(define (problem there) (:domain corridor) (:init (= (x) 0)) (:goal (and)))\n"


def test_where_no_plan_was_written_the_folder_is_as_before(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    (tmp_path / "empty").mkdir()
    for folder in (tmp_path / "runs" / "deep" / "c", tmp_path / "empty"):
        with pytest.raises(ValueError, match="no"), writing(folder):
            (folder / "domains").mkdir()
            (folder / "domains" / "walk.pddl").write_text("")
            raise ValueError("no")
    (tmp_path / "empty" / ".lock").unlink()
    assert {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")} == {
        "mine", "mine/notes.txt", "empty",
    }  # fmt: skip


@pytest.mark.parametrize(("name", "what"), [("notes.txt", "other files"), ("config.json", "a run")])
def test_a_folder_that_holds_something_else_is_refused(
    tmp_path: Path, name: str, what: str
) -> None:
    (tmp_path / "domains").mkdir()
    (tmp_path / "domains" / "mine.pddl").write_text("mine")
    (tmp_path / name).write_text("mine")
    with pytest.raises(RunError, match=f"holds {what}, not a comparison"), writing(tmp_path):
        pass
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["domains", name])
    assert (tmp_path / "domains" / "mine.pddl").read_text() == "mine"


def test_a_plan_that_was_written_stays_and_one_process_at_a_time_writes(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    with pytest.raises(ValueError, match="no"), writing(folder):
        (folder / "plan.json").write_text("{}")
        with pytest.raises(RunError, match="being written by process"), writing(folder):
            pass
        raise ValueError("no")
    assert (folder / "plan.json").exists()
    with writing(folder):
        pass


def test_a_plan_is_read_as_it_was_written(tmp_path: Path) -> None:
    plan = ComparisonPlan(
        task="walk",
        variants=("walk", "other"),
        algorithms={"serp": {}, "serp:x": {"arbiter": {"r_min": None, "rho": 0.5}}},
        trials=(Trial("serp", "walk", 3),),
        protocol=PROTOCOL,
        changes={"learner": {"hidden": (8, 8)}},
        threshold=None,
        max_ground_schemas=70,
    )
    assert read_plan(tmp_path) is None
    write_plan(tmp_path, plan)
    assert read_plan(tmp_path) == plan


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is damaged"),
        ('{"algorithms": 3}', "is not the plan of a comparison"),
        ('{"format": 3}', "was written by another version of serp"),
    ],
)
def test_a_plan_that_cannot_be_read_is_named(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "plan.json").write_text(text)
    with pytest.raises(RunError, match=f"plan.json {message}"):
        read_plan(tmp_path)


def test_the_domain_file_is_kept_as_it_was(tmp_path: Path) -> None:
    task = walk(tmp_path)
    kept = keep_domain(tmp_path, "walk", task.load(), task)
    assert Path(str(kept.domain)) == tmp_path / "domains" / "walk.pddl"
    (tmp_path / "corridor.pddl").write_text(CORRIDOR.replace("decrease (x) 1", "decrease (x) 2"))
    assert kept.load().source.text == CORRIDOR
    with pytest.raises(RunError, match="differs from the domain file `walk`"):
        keep_domain(tmp_path, "walk", task.load(), task)
    assert kept.load().source.text == CORRIDOR


def test_a_problem_file_is_kept_with_it_and_missed_when_it_is_gone(tmp_path: Path) -> None:
    task, beside = walk(tmp_path), tmp_path / "corridor-problem.pddl"
    beside.write_text(PROBLEM)
    kept = keep_domain(tmp_path, "walk", task.load(), task)
    assert kept.load().problem_source is not None
    assert keep_domain(tmp_path, "walk", task.load(), task) == kept
    beside.write_text(PROBLEM.replace("(= (x) 0)", "(= (x) 1)"))
    with pytest.raises(RunError, match="walk-problem.pddl differs from"):
        keep_domain(tmp_path, "walk", task.load(), task)
    beside.unlink()
    with pytest.raises(RunError, match="walk-problem.pddl is a problem file"):
        keep_domain(tmp_path, "walk", task.load(), task)
