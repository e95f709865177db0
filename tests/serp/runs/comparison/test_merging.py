"""Comparisons of several writers become one, or nothing changes."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from serp.errors import Notice, RunError
from serp.runs.comparison.compare import compare, made_alike
from serp.runs.comparison.plan import Trial
from serp.runs.comparison.trial_files import read_trial
from tests.serp.runs.comparison.contest import everything, small, trials_in, walk


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with comparisons: seed 0 of two algorithms, and seeds 0 and 1 of one of them."""
    folder = tmp_path_factory.mktemp("parts")
    small(walk(folder), folder / "a", seeds=1)
    small(walk(folder), folder / "b", algorithms=["dqn"])
    return folder


@pytest.fixture
def copy(parts: Path, tmp_path: Path) -> Path:
    shutil.copytree(parts, tmp_path / "copied")
    return tmp_path / "copied"


def test_a_merged_comparison_has_all_trials_and_runs_what_nobody_has_run(copy: Path) -> None:
    own, other = trials_in(copy / "a"), everything(copy / "b")
    merged = small(walk(copy), copy / "a", merge=[copy / "b"])
    now = everything(copy / "a")
    assert {name: now[name] for name in other} == other
    assert set(now) == {f"trials/{name}/walk/seed-{seed}" for name, seed in (
        ("serp", 0), ("dqn", 0), ("dqn", 1))}  # fmt: skip
    after = trials_in(copy / "a")
    assert {name: after[name] for name in own} == own
    assert list(merged.results.plan.algorithms) == ["serp", "dqn"]
    # Into a new folder, with a trial left that had not ended.
    (copy / "b" / "trials" / "dqn" / "walk" / "seed-1" / "trial.json").unlink()
    small(walk(copy), copy / "new", merge=[copy / "b", copy / "a"])
    new = everything(copy / "new")
    assert {name: new[name] for name in now} == now


def edited(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("trials/dqn/walk/seed-0/episodes.csv", ",a return,", ",-77.0,", "have different numbers"),
        ("trials/dqn/walk/seed-1/trial.json", '"domain": "', '"domain": "0', "made with other"),
        ("domains/walk.pddl", "(increase (reward) 5)", "(increase (reward) 6)",
         r"walk.pddl differs from that"),
        ("plan.json", '"env_steps": 60', '"env_steps": 61', "b has another budget or evaluations"),
        ("plan.json", '"task": "walk"', '"task": "ride"', "b has another task than .*a"),
        ("plan.json", '"epsilon_start": 1.0', '"epsilon_start": 0.9', "other settings of `dqn`"),
        ("trials/dqn/walk/seed-1/episodes.csv", "episode,", "episod,", "episodes.csv"),
    ],
)  # fmt: skip
def test_contradictions_are_refused_and_nothing_changes(
    copy: Path, file: str, old: str, new: str, message: str
) -> None:
    def content() -> dict[Path, bytes]:
        files = (path for path in (copy / "a").rglob("*") if path.is_file())
        return {path: path.read_bytes() for path in files if path.name != ".lock"}

    path = copy / "b" / file
    if old == ",a return,":
        old = f",{path.read_text().splitlines()[-1].split(',')[2]},"
    edited(path, old, new)
    before = content()
    with pytest.raises(RunError, match=message):
        small(walk(copy), copy / "a", merge=[copy / "b"])
    assert content() == before


def test_what_is_merged_has_to_be_a_comparison_and_a_folder_named(copy: Path) -> None:
    with pytest.raises(RunError, match="nosuch holds no comparison. Nothing was merged."):
        small(walk(copy), copy / "a", merge=[copy / "nosuch"])
    with pytest.raises(RunError, match="say which folder the others are merged into"):
        compare(walk(copy), merge=[copy / "b"])


def test_trials_of_other_versions_are_noticed(copy: Path) -> None:
    done = copy / "b" / "trials" / "dqn" / "walk" / "seed-1" / "trial.json"
    found = json.loads(done.read_text())
    done.write_text(json.dumps(found | {"versions": found["versions"] | {"numpy": "1.0.0"}}))
    with pytest.warns(Notice, match=r"different versions of numpy \(1.0.0, "):
        merged = small(walk(copy), copy / "a", merge=[copy / "b"], report=True)
    (note,) = made_alike(merged.results.records)
    assert note in (copy / "a" / "report.md").read_text()
    assert made_alike([read_trial(copy / "a", Trial("serp", "walk", 0))]) == []
