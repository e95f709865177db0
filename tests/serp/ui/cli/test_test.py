"""`serp test`."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from tests.serp.ui.cli.conftest import QUICK as LEARN
from tests.serp.ui.cli.conftest import Run

DOMAINS = Path(__file__).resolve().parents[4] / "domains"

QUICK = ("--set=planner.name=lookahead", "--set=planner.depth=2")


def test_it_reports_like_a_test_runner(run: Run, walk: Path) -> None:
    Path("walk.scenarios").write_text(
        "scenario mines\n  refuses go home field because unsafe\n"
        "scenario a wish\n  chooses go home field\n"
    )
    shown = run("test", *QUICK, expect=1).stdout
    assert "  ok    mines\n" in shown and "  FAIL  a wish\n" in shown
    assert "line 4: chooses go home field" in shown and "1 passed, 1 failed" in shown
    told = json.loads(run("test", "walk.pddl", "-k", "Wish", "--json", *QUICK, expect=1).stdout)
    assert (told["passed"], told["failed"], told["wrong"]) == (0, 1, 0)
    (failed,) = told["scenarios"]
    assert failed["line"] == 3 and failed["failures"][0]["expected"] == "chooses go home field"
    assert "1 passed" in run("test", "walk.scenarios", "-k", "mines", *QUICK).stdout


def test_without_scenarios_it_says_how_to_write_one(run: Run, walk: Path) -> None:
    told = run("test", "walk.pddl", expect=1).stderr
    assert "there is no walk.scenarios" in told and "scenario what the planner does" in told
    assert "name a domain file or a task" in run("test", expect=2).stderr
    Path("walk.scenarios").write_text("scenario one\n  allows rest\n")
    assert "no scenario has the words `two`" in run("test", "-k", "two", *QUICK, expect=1).stderr
    Path("walk.scenarios").write_text("scenario one\n  alows rest\n  allows rst\n")
    told = run("test", *QUICK, expect=1).stderr
    assert "Error: walk.scenarios:2:3: " in told and "\nwalk.scenarios:3:10: " in told


def test_a_recorded_step_becomes_a_scenario_and_other_lines_stay(run: Run, folder: Path) -> None:
    shutil.copy(DOMAINS / "cartpole.pddl", folder)
    run("plan-and-learn", "--domain=cartpole.pddl", "--env-steps=20", "--out=r", *LEARN)
    first = "scenario A\r\n  allows push-left ; always\r\n\r\nscenario b\r\n  allows push-left"
    Path("cartpole.scenarios").write_bytes(first.encode())
    update = ("test", "cartpole.pddl", "--update=r", *QUICK)
    run(*update, "--step=3")
    text = Path("cartpole.scenarios").read_bytes().decode()
    assert text.startswith(f"{first}\r\n\r\nscenario step 3 of r\r\n  ; step 3 of r: ")
    run(*update, "--episode=1", "--step=4", "--title=a")  # the same step, in place of the first
    replaced = Path("cartpole.scenarios").read_bytes().decode()
    assert replaced.endswith(text.partition("always")[2])
    situation = [line for line in text.splitlines() if line.startswith("  (")]
    assert (
        len(situation) == 4
        and [line for line in replaced.splitlines() if line in situation][:4] == situation
    )
    assert "3 passed" in run("test", "cartpole.pddl", *QUICK).stdout
    Path("like.scenarios").write_text("scenario one\n  like step 3 of r\n  allows push-left\n")
    like = run("test", "cartpole.pddl", "--scenarios=like.scenarios", *QUICK).stdout
    assert "1 passed" in like
    told = run(*update, "--step=3000", expect=1).stderr
    assert "there is no step 3,000" in told
    assert Path("cartpole.scenarios").read_bytes().decode() == replaced
