"""`serp check`."""

import json
import os
from pathlib import Path

from tests.serp.ui.cli.conftest import WALK, WALK_PROBLEM
from tests.worlds import DOMAINS

MISSPELT = WALK.replace("(increase (walked) 1)", "(increase (walkd) 1)")


def test_a_file_that_does_not_fit_its_task_is_warned_of(run, folder):
    text = (DOMAINS / "cartpole.pddl").read_text()
    in_degrees = text.replace("(> (pole-angle) 0.2618)", "(> (pole-angle) 12)")
    assert in_degrees != text
    Path("cartpole.pddl").write_text(in_degrees)
    shown = run("check", "cartpole.pddl").stdout
    assert (
        "grounding and actions fit together; no step was tried" in shown
        and "time limit" not in shown
    )
    (line,) = (line for line in shown.splitlines() if line.startswith("  warning"))
    assert "`(> (pole-angle) 12)`: the observations of the task give `pole-angle` values" in line
    assert "from −0.52" in line and "is 12 in the same unit?" in line
    Path("cartpole.pddl").write_text(text.replace("(pole-angle)      ;", "(wind) (pole-angle) ;"))
    shown = run("check", "cartpole.pddl").stdout
    assert "warning: task cartpole: the grounding does not fit cartpole.pddl: " in shown
    assert "found 4: none for `pole-velocity`" in shown


def test_every_file_is_checked_even_where_the_first_is_wrong(run, walk):
    Path("bad.pddl").write_text(MISSPELT)
    Path("self.pddl").symlink_to("self.pddl")
    os.mkfifo("pipe.pddl")
    wrong = ("bad.pddl", "nosuch.pddl", "self.pddl", "pipe.pddl", "nosuch", ".")
    result = run("check", *wrong, "walk.pddl", expect=1)
    assert "walk.pddl: well formed" in result.stdout
    for said in (
        "bad.pddl:10:51: unknown function `walkd`",
        "did you mean `walked`?",
        "nosuch.pddl: there is no such file",
        "self.pddl: cannot be read (Too many levels of symbolic links)",
        "pipe.pddl: cannot be read (it is not a regular file)",
        "there is no task `nosuch`",
        ". is a folder",
    ):
        assert said in result.stderr
    assert "bad.pddl: 1 error" in result.stdout
    assert "7 domains: 6 wrong, 0 warnings" in result.stdout


def test_a_domain_and_a_problem_of_any_name_are_one_check(run, walk):
    Path("p01.pddl").write_text(WALK_PROBLEM.replace("field", "meadow"))
    Path("p02-problem.pddl").write_text("; a comment\n(DEFINE (PROBLEM p2) (:domain walk))")
    Path("other.pddl").write_text(WALK.replace("domain walk", "domain stroll"))
    shown = run("check", "other.pddl", "p01.pddl", "walk.pddl", "p02-problem.pddl").stdout
    assert [line for line in shown.splitlines() if "domain " in line] == [
        "  domain stroll (other.pddl, no problem file)",
        "  domain walk (walk.pddl, p01.pddl)",
        "  domain walk (walk.pddl, p02-problem.pddl)",
    ]
    Path("domain.pddl").write_text(WALK)
    Path("walk.pddl").unlink()
    assert "domain walk (domain.pddl, p01.pddl)" in run("check", "p01.pddl").stdout


def test_findings_are_printed_for_programs(run, walk):
    walk.write_text(WALK.replace("(assign (walked) 0)", "(walked = 0)"))
    findings = json.loads(run("check", "walk.pddl", "--json", expect=1).stdout)
    assert [(f["code"], f["place"]["line"], f["fix"]["sure"]) for f in findings] == [
        ("foreign-syntax", 15, True)
    ]


def test_initial_values_are_not_missed_where_an_environment_gives_them(run, folder):
    (folder / "stay.pddl").write_text(
        "(define (domain stay) (:functions (at) (reward))"
        " (:action left :effect (decrease (at) 1))"
        " (:action right :effect (and (increase (at) 1) (increase (reward) 1))))"
    )
    (folder / "stay-problem.pddl").write_text("(define (problem p) (:domain stay) (:init))")
    (folder / "stay.py").write_text(
        "import gymnasium\nfrom serp import Task\n"
        "task = lambda: Task(domain='stay.pddl', make_env=lambda: gymnasium.make('CartPole-v1'),"
        " ground=lambda observation, info, env: {'at': observation[0]})\n"
    )
    assert "starts at 0" in run("check", "stay.pddl").stdout
    shown = run("check", "--task", "stay.py:task").stdout
    assert "fit together" in shown and "starts at 0" not in shown
