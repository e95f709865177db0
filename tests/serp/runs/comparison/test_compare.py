"""Whole comparisons: what is run, what is kept, what is refused."""

import shutil
import sys
from importlib.metadata import EntryPoint

import numpy as np
import pytest

from serp.errors import RunError, SerpError, SettingsError, TaskError
from serp.pddl.source import DomainError
from serp.runs.comparison.compare import compare
from serp.runs.comparison.trial import file_name
from tests.serp.runs.comparison import contest
from tests.serp.runs.comparison.contest import Pothole, everything, small, trials_in, walk
from tests.serp.sample_tasks import CORRIDOR


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of an undisturbed comparison, and the domain file beside it."""
    folder = tmp_path_factory.mktemp("whole")
    small(walk(folder), folder / "c", report=True)
    return folder


@pytest.fixture
def copy(whole, tmp_path):
    """A copy of it, to be continued."""
    shutil.copytree(whole, tmp_path / "copied")
    return tmp_path / "copied"


def again(folder, **options):
    return small(walk(folder), folder / "c", **options)


# What is run --------------------------------------------------------------------------------------


def test_everything_that_was_asked_for_is_run_and_reported(whole, copy):
    folder = whole / "c"
    assert set(trials_in(folder)) == {"serp-0", "serp-1", "dqn-0", "dqn-1"}
    for name in ("report.html", "measures.csv"):
        assert (folder / name).stat().st_size > 0
    head, rows = again(copy).overview()  # nothing is left to do
    assert [row[0] for row in rows] == ["serp", "dqn"]
    assert {len(row) for row in rows} == {len(head)}
    (learned,) = again(copy).results.rewards
    for shown in (learned, (folder / "report.html").read_text()):
        assert "The learner learns from the " in shown


def test_only_what_is_missing_is_run(copy):
    before = trials_in(copy / "c")
    again(copy, algorithms=["mrp", "serp"], seeds=np.array([1, 4]))
    now = trials_in(copy / "c")
    assert set(now) - set(before) == {"mrp-0", "mrp-1", "mrp-4", "serp-4", "dqn-4"}
    assert {name: now[name] for name in before} == before
    after = again(copy)  # it is a part of the comparison from now on
    assert trials_in(copy / "c") == now
    assert after.results.plan.algorithms[:2] == ("serp", "dqn")  # the first stays


def test_a_domain_file_is_another_algorithm(copy):
    coarse = copy / "coarse.pddl"
    coarse.write_text(CORRIDOR.replace("increase (x) 1", "increase (x) 2"))
    before = trials_in(copy / "c")
    results = again(copy, algorithms=["serp@coarse"]).results
    assert set(trials_in(copy / "c")) - set(before) == {
        f"{file_name('serp@coarse')}-{seed}" for seed in (0, 1)
    }
    assert results.known("serp@coarse", "training_area").tolist() != []
    coarse.write_text(CORRIDOR)
    with pytest.raises(RunError, match="was made with different domain files"):
        again(copy)


def test_a_controller_of_the_user_is_a_baseline(copy, monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path])
    name = f"baseline={contest.__name__}:onward"
    results = again(copy, baseline=name.removeprefix("baseline=")).results
    assert results.algorithms[-1] == name
    assert results.known(name, "final_policy").min() >= results.known("dqn", "final_policy").max()
    assert f"{name}: no clear difference" in " ".join(again(copy).results.verdicts)


def test_settings_are_the_same_when_it_is_continued(tmp_path):
    """Infinite and listed ones, and those of one algorithm alone, too."""
    changes = {"learner": {"hidden": [8, 8]}}
    asked = {
        "settings": changes, "algorithms": ["dqn", "dqn:learner.epsilon_end=0.0"]
    }  # fmt: skip
    small(walk(tmp_path), tmp_path / "c", seeds=1, **asked)
    before = everything(tmp_path / "c")
    small(walk(tmp_path), tmp_path / "c", **asked)
    small(walk(tmp_path), tmp_path / "c", seeds=2)
    now = everything(tmp_path / "c")
    assert len(now) == 4 and now.items() >= before.items()


def test_an_engine_by_its_name_finds_what_this_process_finds(tmp_path, whole, monkeypatch):
    entry = EntryPoint("threads", "tests.serp.runs.comparison.contest:threads", "serp.engines")
    monkeypatch.setattr("serp.runs.comparison.pool.offered", lambda group: {"threads": entry})
    small(walk(tmp_path), tmp_path / "c", engine="threads", address="there:1", jobs=2)
    assert everything(tmp_path / "c") == everything(whole / "c")
    here_only = walk(tmp_path, ground=lambda seen: {"x": seen[0]})
    with pytest.raises(RunError, match="engine threads: the task has functions that cannot be"):
        small(here_only, tmp_path / "d", engine="threads")
    with pytest.raises(SettingsError, match="there is no engine `tread`; did you mean `threads`"):
        small(walk(tmp_path), tmp_path / "d", engine="tread")


def test_an_installed_task_by_its_name(tmp_path):
    comparison = small("cartpole", tmp_path / "c", algorithms=["mrp"], seeds=1)
    assert comparison.results.plan.threshold == 475.0


# What goes wrong while it runs ------------------------------------------------------------------


def test_a_trial_that_fails_is_reported_and_the_others_are_kept(tmp_path, whole):
    with pytest.raises(RunError) as failure:
        small(walk(tmp_path, Pothole), tmp_path / "c", report=True)
    message = str(failure.value)
    assert message.startswith("2 of 4 trials failed. The first failure: serp, seed 1: ")
    assert "cable cut" in message and str(tmp_path / "c") in message
    report = (tmp_path / "c" / "report.html").read_text()
    assert "not complete: 2 of 4 trials are finished" in report and "serp, seed 1" in report
    small(walk(tmp_path), tmp_path / "c")
    assert everything(tmp_path / "c") == everything(whole / "c")


# What is refused ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"env_steps": 61}, "this comparison has env_steps = 60, not 61"),
        ({"settings": {"learner": {"members": 1}}}, "was made with different settings"),
        ({"seeds": []}, "seeds must be a number of seeds, at least 1"),
        ({"seeds": [1, -1]}, "seed"),
        ({"algorithms": 3}, "algorithms must be a list, not 3"),
        ({"threshold": float("nan")}, "threshold must be a finite number"),
    ],
)
def test_what_cannot_change_is_refused(copy, options, message):
    def content():
        files = (path for path in copy.rglob("*") if path.is_file() and path.name != ".lock")
        return {path: path.read_bytes() for path in files}

    before = content()
    with pytest.raises(SerpError, match=message):
        again(copy, **options)
    assert content() == before


def test_an_edited_domain_file_another_task_and_other_settings_are_refused(copy):
    edited = CORRIDOR.replace("decrease (reward) 5", "decrease (reward) 6")
    (copy / "corridor.pddl").write_text(edited)
    with pytest.raises(RunError, match="was made with different domain files"):
        again(copy)
    (copy / "corridor.pddl").write_text(CORRIDOR)
    with pytest.raises(SettingsError, match="comparison has task = walk, not ride"):
        small(walk(copy, name="ride"), copy / "c")
    task = walk(copy, settings={"*": {**walk(copy).settings["*"], "planner": {"depth": 1}}})
    with pytest.raises(RunError, match="was made with different settings"):
        small(task, copy / "c")
    (copy / "c" / "plan.json").write_text("{}")
    with pytest.raises(RunError, match="plan.json is damaged, or was written by another version"):
        again(copy)


@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({"algorithms": ["srep"]}, SettingsError, "did you mean `serp`"),
        ({"algorithms": ["DQN"]}, SettingsError, "did you mean `dqn`"),
        ({"algorithms": ["dqn:x"]}, SettingsError, "x: expected section.name=value"),
        ({"algorithms": ["absent"]}, RunError, "more memory than there is"),
        ({"algorithms": ["late"]}, SettingsError, "first learns after 61 env steps"),
        ({"baseline": "json:lode"}, TaskError, "--baseline=json:lode: .*did you mean `load`"),
        ({"settings": {"lerner": {}}}, SettingsError, "did you mean `learner`"),
        ({"address": "a:1"}, SettingsError, "compare.address needs an engine for clusters"),
        ({"task": 3}, TaskError, "not 3"),
        ({"sedes": 3}, SettingsError, "no setting `compare.sedes`; did you mean `seeds`"),
        ({"algorithms": ["serp@nosuch"]}, DomainError, "nosuch.pddl: there is no such file"),
        ({"algorithms": ["dqn@odd"]}, SettingsError, "`dqn@odd`: NAME@FILE needs"),
        ({"algorithms": ["mrp@a/broken.pddl"]}, DomainError, "broken.pddl"),
        ({"algorithms": ["mrp@odd"]}, TaskError, "5 ground actions, but the environment has 4"),
        ({"out": 3}, SettingsError, "compare.out"),
        ({"out": "a"}, RunError, "a is not empty"),
    ],
)  # fmt: skip
def test_mistakes_leave_nothing_behind(
    tmp_path, options, kind, message, external,
    monkeypatch,
):  # fmt: skip
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.chdir(tmp_path)
    (tmp_path / "walk.pddl").write_text(CORRIDOR)
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "broken.pddl").write_text("(define (domain")
    action = "(:action {} :parameters () :precondition (and) :effect (and))\n"
    more = action.format("jump") + action.format("fly") + "(:event pit"
    (tmp_path / "odd.pddl").write_text(CORRIDOR.replace("(:event pit", more))
    given = {"task": walk(tmp_path), "env_steps": 60, "quiet": True}
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(kind, match=message):
        compare(**{**given, **options})
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(("old", "new"), [("\n30,learner", "\n30,other"), ("return", "ret")])
def test_a_damaged_evaluation_is_reported(copy, old, new):
    file = copy / "c" / "trials" / "serp-0" / "evaluations.csv"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    with pytest.raises(RunError, match=r"evaluations\.csv .*Remove the folder of this trial"):
        again(copy, report=True)


def test_another_process_that_changes_the_plan_meanwhile_is_noticed(copy, monkeypatch):
    def changed(*arguments):
        plan.write_text(plan.read_text().replace('"dqn"', '"mrp"'))
        return []

    plan = copy / "c" / "plan.json"
    monkeypatch.setattr("serp.runs.comparison.compare._jobs", changed)
    with pytest.raises(RunError, match="another process has changed"):
        again(copy)
    assert '"mrp"' in plan.read_text()


@pytest.mark.skipif(sys.platform == "win32", reason="links are privileged there")
@pytest.mark.parametrize("name", ["trials", "figures"])
def test_nothing_is_written_or_removed_behind_a_link(copy, tmp_path, name):
    """A comparison that somebody sent may have a link in it to a folder of one's own."""
    own, folder = tmp_path / "own", copy / "c"
    (folder / name).rename(own)
    if name == "trials":  # something is left to do
        next(own.rglob("summary.json")).unlink()
    (folder / name).symlink_to(own)
    before = {file: file.read_bytes() for file in own.rglob("*") if file.is_file()}
    with pytest.raises(RunError, match=f"{name} is a link"):
        again(copy, report=True)
    assert {file: file.read_bytes() for file in own.rglob("*") if file.is_file()} == before
