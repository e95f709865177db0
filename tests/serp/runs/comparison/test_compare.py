"""Whole comparisons: what is run, what is kept, what is refused."""

from __future__ import annotations

import dataclasses
import shutil
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from serp.errors import RunError, SerpError, SettingsError, TaskError
from serp.model.domain import load_domain
from serp.pddl.source import DomainError
from serp.runs.comparison.compare import compare
from serp.runs.comparison.plan import Trial
from serp.runs.comparison.workers import portable, run_here
from tests.serp.runs.comparison.contest import Pothole, everything, small, trials_in, walk
from tests.serp.sample_tasks import CORRIDOR


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an undisturbed comparison, and the domain file beside it."""
    folder = tmp_path_factory.mktemp("whole")
    small(walk(folder), folder / "c", report=True)
    return folder


@pytest.fixture
def copy(whole: Path, tmp_path: Path) -> Path:
    """A copy of it, to be continued."""
    shutil.copytree(whole, tmp_path / "copied")
    return tmp_path / "copied"


def again(folder: Path, **options: Any) -> Any:
    return small(walk(folder), folder / "c", **options)


# What is run --------------------------------------------------------------------------------------


def test_everything_that_was_asked_for_is_run_and_reported(whole: Path, copy: Path) -> None:
    folder = whole / "c"
    assert set(trials_in(folder)) == {
        f"{name}/walk/seed-{seed}" for name in ("serp", "dqn") for seed in (0, 1)
    }
    # The task is not installed, so the command that begins anew has a placeholder for it.
    assert "--task FILE.py:FUNCTION" in (folder / "report.md").read_text()
    for name in ("report.html", "measures.csv", "episodes.csv", "comparison.json"):
        assert (folder / name).stat().st_size > 0
    assert (folder / "domains" / "walk.pddl").read_text() == CORRIDOR
    before = trials_in(copy / "c")
    head, rows = again(copy).overview()  # nothing is left to do
    assert trials_in(copy / "c") == before
    assert [row[0] for row in rows] == ["serp", "dqn"]
    assert {len(row) for row in rows} == {len(head)}


@pytest.mark.parametrize("lost", ["dqn/walk/seed-1", "all"])
def test_an_interrupted_one_that_is_continued_equals_an_uninterrupted_one(
    copy: Path, whole: Path, lost: str
) -> None:
    kept = trials_in(copy / "c")
    if lost == "all":
        shutil.rmtree(copy / "c" / "trials")
    else:
        (copy / "c" / "trials" / lost / "trial.json").unlink()
    again(copy)
    assert everything(copy / "c") == everything(whole / "c")
    now = trials_in(copy / "c")
    changed = {name for name in kept if now[name] != kept[name]}
    assert changed == ({lost} if lost != "all" else set(kept))


@pytest.mark.parametrize(
    ("more", "added"),
    [
        ({"algorithms": ["mrp", "serp"]}, {"mrp/walk/seed-0", "mrp/walk/seed-1"}),
        ({"seeds": 3}, {"serp/walk/seed-2", "dqn/walk/seed-2"}),
        ({"algorithms": ["dqn"], "seeds": np.array([1, 4])}, {"dqn/walk/seed-4"}),
    ],
)
def test_only_what_is_missing_is_run(copy: Path, more: Any, added: set[str]) -> None:
    before = trials_in(copy / "c")
    again(copy, **more)
    now = trials_in(copy / "c")
    assert set(now) - set(before) == added
    assert {name: now[name] for name in before} == before
    after = again(copy)  # it is a part of the comparison from now on
    assert trials_in(copy / "c") == now
    assert list(after.results.plan.algorithms)[:2] == ["serp", "dqn"]  # the first stays


def test_domain_files_that_come_later_are_run_by_all_that_use_one(copy: Path) -> None:
    coarse = copy / "coarse.pddl"
    other = CORRIDOR.replace("increase (x) 1", "increase (x) 2")
    coarse.write_text(other.replace("(increase (reward) 5)", "(increase (reward) 7)"))
    before = trials_in(copy / "c")
    comparison = again(copy, model_variants=[coarse], report=True)
    added = set(trials_in(copy / "c")) - set(before)
    # What a domain file is worth is what its planner is worth.
    assert added == {f"{name}/{variant}/seed-{seed}" for seed in (0, 1) for name, variant in (
        ("serp", "coarse"), ("mrp", "coarse"), ("mrp", "walk"))}  # fmt: skip
    assert comparison.results.plan.base == "walk"
    (note,) = comparison.results.metadata.notes
    assert "`coarse` rewards other steps than `walk`" in note
    assert "results on it cannot be compared" in (copy / "c" / "report.md").read_text()


def test_settings_are_the_same_when_it_is_continued(tmp_path: Path) -> None:
    """Infinite and listed ones, and those of one algorithm alone, too."""
    task, name = walk(tmp_path), "dqn:x"
    asked: dict[str, Any] = {
        "settings": {
            "learner": {"hidden": [8, 8]},
        },
        "algorithms": ["dqn", name],
        "changed": {name: {"learner": {"epsilon_start": 0.0}}},
    }  # fmt: skip
    small(task, tmp_path / "c", seeds=1, **asked)
    before = trials_in(tmp_path / "c")
    assert len({str(rows) for rows, _ in everything(tmp_path / "c").values()}) == 2
    small(task, tmp_path / "c", **asked)
    assert trials_in(tmp_path / "c") == before
    small(task, tmp_path / "c", seeds=2)
    assert len(trials_in(tmp_path / "c")) == 4


def test_other_processes_are_used_as_far_as_there_is_work(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[set[Trial], int]] = []

    def elsewhere(jobs: Any, pool: Any, on_progress: Any, stopped: Any) -> Any:
        asked.append(({job.trial for job in jobs}, pool.slots))
        return run_here(jobs, on_progress, stopped)

    monkeypatch.setattr("serp.runs.comparison.compare.run_in_executor", elsewhere)
    again(copy, jobs=2)
    assert asked == []
    again(copy, seeds=3, jobs=9)
    again(copy, algorithms=["mrp"], jobs=2)
    assert asked == [
        ({Trial("serp", "walk", 2), Trial("dqn", "walk", 2)}, 2),
        ({Trial("mrp", "walk", seed) for seed in range(3)}, 2),
    ]


def test_what_cannot_be_sent_to_other_processes_runs_in_this_one_and_it_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    task = walk(tmp_path, ground=lambda seen: {"x": seen[0]})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("serp.runs.comparison.compare.run_in_executor", None)
        small(task, tmp_path / "c", jobs=2, quiet=False, seeds=1)
    shown = capsys.readouterr().err
    assert "one after another: the task has functions that cannot be imported" in shown
    assert len(trials_in(tmp_path / "c")) == 2


def test_an_engine_by_its_name_finds_what_this_process_finds(
    tmp_path: Path, whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    entry = EntryPoint("threads", "tests.serp.runs.comparison.contest:threads", "serp.engines")
    monkeypatch.setattr("serp.runs.comparison.workers.offered", lambda group: {"threads": entry})
    small(walk(tmp_path), tmp_path / "c", engine="threads", address="there:1", jobs=2)
    assert everything(tmp_path / "c") == everything(whole / "c")
    here_only = walk(tmp_path, ground=lambda seen: {"x": seen[0]})
    with pytest.raises(RunError, match="engine threads: the task has functions that cannot be"):
        small(here_only, tmp_path / "d", engine="threads")
    with pytest.raises(SettingsError, match="there is no engine `tread`; did you mean `threads`"):
        small(walk(tmp_path), tmp_path / "d", engine="tread")


def test_an_installed_task_by_its_name_and_continued_by_nothing_but_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the domain file as it was: that in the working directory may be another by then."""
    monkeypatch.chdir(tmp_path)
    shipped = Path(__file__).parents[4] / "domains" / "cartpole.pddl"
    own = shipped.read_text().replace("0.195", "0.2")
    assert own != shipped.read_text()
    (tmp_path / "cartpole.pddl").write_text(own)
    out = tmp_path / "c"
    small("cartpole", out, algorithms=["mrp"], seeds=1, settings={"planner": {"depth": 2}})
    (tmp_path / "cartpole.pddl").unlink()
    comparison = small(None, out, seeds=2)
    assert (out / "domains" / "cartpole.pddl").read_text() == own
    assert len(comparison.results.records) == 2
    assert comparison.results.plan.threshold == 475.0


# What goes wrong while it runs ------------------------------------------------------------------


def test_a_trial_that_fails_is_told_and_the_others_are_kept(tmp_path: Path) -> None:
    task = walk(tmp_path, Pothole)
    with pytest.raises(RunError) as failure:
        small(task, tmp_path / "c", seeds=3, report=True)
    message = str(failure.value)
    assert message.startswith("2 of 6 trials failed; the first, serp on walk, seed 1: ")
    assert "cable cut" in message and str(tmp_path / "c") in message
    assert set(trials_in(tmp_path / "c")) == {
        f"{name}/walk/seed-{seed}" for name in ("serp", "dqn") for seed in (0, 2)
    }
    assert (tmp_path / "c" / "report.html").exists()
    mended = small(walk(tmp_path), tmp_path / "c")
    assert len(mended.results.records) == 6


# What is refused ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"env_steps": 61}, "this comparison has env_steps = 60, not 61"),
        ({"final_episodes": 9}, "has final_episodes = 2, not 9"),
        ({"settings": {"learner": {"members": 1}}}, "settings of a comparison cannot change"),
        ({"seeds": []}, "seeds must be how many, at least 1"),
        ({"seeds": [1, -1]}, "seed"),
        ({"seeds": 1.5}, "seeds must be"),
        ({"algorithms": 3}, r"algorithms must be a list .* such as \['serp', 'dqn'\], not 3"),
        ({"threshold": float("nan")}, "threshold must be a finite number"),
    ],
)
def test_what_cannot_change_is_refused(copy: Path, options: Any, message: str) -> None:
    def content() -> dict[Path, bytes]:
        files = (path for path in copy.rglob("*") if path.is_file() and path.name != ".lock")
        return {path: path.read_bytes() for path in files}

    before = content()
    with pytest.raises(SerpError, match=message):
        again(copy, **options)
    assert content() == before


def test_an_edited_domain_file_is_refused(copy: Path) -> None:
    edited = CORRIDOR.replace("decrease (reward) 5", "decrease (reward) 6")
    (copy / "corridor.pddl").write_text(edited)
    with pytest.raises(RunError, match="differs from the domain file `walk`, which was edited"):
        again(copy)
    (copy / "corridor.pddl").write_text(CORRIDOR)
    again(copy)
    (copy / "c" / "domains" / "walk.pddl").write_text(edited)  # the kept one, behind its back
    (copy / "corridor.pddl").write_text(edited)
    with pytest.raises(RunError, match="was made with another domain file than now"):
        again(copy)


def test_another_task_or_one_with_other_settings_is_refused(copy: Path) -> None:
    with pytest.raises(RunError, match="compares on task walk, not on ride"):
        small(walk(copy, name="ride"), copy / "c")
    task = walk(copy, settings={"*": {**walk(copy).settings["*"], "planner": {"depth": 1}}})
    with pytest.raises(RunError, match="was made with other settings than now"):
        small(task, copy / "c")


@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({"algorithms": ["srep"]}, SettingsError, "did you mean `serp`"),
        ({"algorithms": ["dqn:x"]}, SettingsError, "`dqn:x`: say in `changed`"),
        ({"algorithms": ["absent"]}, RunError, "more memory than there is"),
        ({"settings": {"lerner": {}}}, SettingsError, "did you mean `learner`"),
        ({"settings": {"guide": {"strategy": "jump"}}}, SettingsError, "there is no strategy"),
        ({"address": "a:1"}, SettingsError, "compare.address is for an engine of a cluster"),
        ({"merge": "a"}, SettingsError, "compare.merge must be a list of folders"),
        ({"sedes": 3}, SettingsError, "no setting `compare.sedes`; did you mean `seeds`"),
        ({"env_steps": "many"}, SettingsError, "env_steps must be"),
        ({"model_variants": ["a/other.pddl", "b/other.pddl"]}, SettingsError,
         "two model variants are called `other`"),
        ({"model_variants": ["nosuch.pddl"]}, TaskError, "nosuch.pddl"),
        ({"model_variants": ["a/broken.pddl"]}, DomainError, "broken.pddl"),
        ({"model_variants": ["walk.pddl"]}, SettingsError, "needs another name"),
        ({"out": "a\0b"}, SettingsError, "out must be the name of a folder"),
    ],
)  # fmt: skip
def test_mistakes_leave_nothing_behind(
    tmp_path: Path, options: Any, kind: type[SerpError], message: str, external: None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    (tmp_path / "walk.pddl").write_text(CORRIDOR)
    for name in ("a/other", "b/other"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / f"{name}.pddl").write_text(CORRIDOR)
    (tmp_path / "a" / "broken.pddl").write_text("(define (domain")
    task = walk(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    given: dict[str, Any] = {"env_steps": 60, "quiet": True}
    with pytest.raises(kind, match=message):
        compare(task, **{**given, **options})
    assert sorted(tmp_path.rglob("*")) == before


def test_a_domain_file_that_does_not_fit_the_task_is_refused(tmp_path: Path) -> None:
    other = tmp_path / "other.pddl"
    other.write_text(CORRIDOR.replace("(:event pit", "(:action jump :parameters () "
                     ":precondition (and) :effect (and))\n (:action fly :parameters () "
                     ":precondition (and) :effect (and))\n (:event pit"))  # fmt: skip
    with pytest.raises(TaskError, match="5 ground actions, the environment 4"):
        small(walk(tmp_path), tmp_path / "c", model_variants=[other])
    assert not (tmp_path / "c").exists()


def test_what_to_compare_on_has_to_be_said(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="name a task"):
        compare(quiet=True)
    with pytest.raises(RunError, match="c holds no comparison yet"):
        compare(out=tmp_path / "c", quiet=True)
    wrong: Any = 3
    with pytest.raises(TaskError, match="not 3"):
        compare(wrong, quiet=True)
    assert list(tmp_path.iterdir()) == []


def test_a_larger_domain_than_usual_stays_allowed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[bool] = []

    def elsewhere(jobs: Any, pool: Any, on_progress: Any, stopped: Any) -> Any:
        asked.append(portable(jobs))
        return run_here(jobs, on_progress, stopped)

    monkeypatch.setattr("serp.runs.comparison.compare.run_in_executor", elsewhere)
    task = walk(tmp_path)
    domain = load_domain(task.load().source.name, observed=True, max_ground_schemas=70_000)
    large = dataclasses.replace(task, domain=domain)
    comparison = small(large, tmp_path / "c", algorithms=["mrp"], jobs=2)
    assert asked == [True]
    monkeypatch.setattr("serp.runs.comparison.request.load_task", lambda name: task)
    continued = small(None, tmp_path / "c", seeds=3)
    for each in (comparison, continued):
        assert "--max-ground-schemas 70000" in each.results.metadata.command


@pytest.mark.skipif(sys.platform == "win32", reason="links are privileged there")
@pytest.mark.parametrize("name", ["trials", "domains", "figures"])
def test_nothing_is_written_or_removed_behind_a_link(copy: Path, tmp_path: Path, name: str) -> None:
    """A comparison that somebody sent may have a link in it to a folder of one's own."""
    own, folder = tmp_path / "own", copy / "c"
    (folder / name).rename(own)
    if name == "trials":  # something is left to do
        next(own.rglob("trial.json")).unlink()
    (folder / name).symlink_to(own)
    before = {file: file.read_bytes() for file in own.rglob("*") if file.is_file()}
    with pytest.raises(RunError, match=f"{name} is a link"):
        again(copy, report=True)
    assert {file: file.read_bytes() for file in own.rglob("*") if file.is_file()} == before
