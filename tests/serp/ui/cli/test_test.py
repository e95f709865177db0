"""`serp test`."""

import json
import shutil
from pathlib import Path

from tests.serp.ui.cli.conftest import QUICK as LEARN
from tests.worlds import DOMAINS

QUICK = ("--set=planner.name=lookahead", "--set=planner.depth=2")


def test_it_reports_like_a_test_runner(run, walk):
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


def test_a_situation_is_that_of_a_recorded_step(run, folder):
    shutil.copy(DOMAINS / "cartpole.pddl", folder)
    run("plan-and-learn", "--domain=cartpole.pddl", "--env-steps=20", "--out=r", *LEARN)
    step = "scenario one\n  like step {} of r\n  allows push-left\n"
    Path("like.scenarios").write_text(step.format(3) + step.format("3 of episode 1"))
    test = ("test", "cartpole.pddl", "--scenarios=like.scenarios", *QUICK)
    assert "two scenarios" in run(*test, expect=1).stderr
    Path("like.scenarios").write_text(step.format("3 of episode 1"))
    assert "1 passed" in run(*test).stdout
    Path("like.scenarios").write_text(step.format(3000))
    assert "like.scenarios:2:" in (told := run(*test, expect=1).stderr)
    assert "there is no step 3,000" in told
