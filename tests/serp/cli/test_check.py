"""`serp check`."""

from __future__ import annotations

from pathlib import Path

from tests.serp.cli.conftest import WALK, WALK_PROBLEM, Run

MISSPELT = WALK.replace("(increase (walked) 1)", "(increase (walkd) 1)")


def test_a_right_file_is_summed_up(run: Run, walk: Path) -> None:
    shown = run("check", "walk.pddl").stdout
    assert "walk.pddl: right" in shown
    assert "domain walk (walk.pddl, walk-problem.pddl)" in shown
    assert "4 fluents, 4 ground actions, 0 processes, 0 events, 5 literals, 3 objects" in shown
    assert "unsafe: action go" in shown
    assert "reward: action go, action rest" in shown
    assert "terminal: nothing" in shown
    assert "unified-planning reads it: yes" in shown
    assert "warning" not in shown


def test_an_installed_task_is_checked_by_name(run: Run) -> None:
    shown = run("check", "cartpole").stdout
    assert "cartpole: right" in shown
    assert "unsafe: event fall" in shown
    assert "warning" not in shown


def test_symmetries_are_told(run: Run) -> None:
    assert "symmetry: left <-> right\n" in run("check", "soccer").stdout
    assert "symmetry" not in run("check", "cartpole").stdout


def test_a_wrong_file_is_said_where_and_what(run: Run, folder: Path) -> None:
    Path("walk.pddl").write_text(MISSPELT)
    line = MISSPELT.splitlines().index(next(x for x in MISSPELT.splitlines() if "walkd" in x)) + 1
    result = run("check", "walk.pddl", expect=1)
    assert "walk.pddl: wrong" in result.stdout
    assert f"walk.pddl:{line}:" in result.stderr
    assert "unknown function `walkd`" in result.stderr
    assert "^^^^^" in result.stderr
    assert "did you mean `walked`?" in result.stderr


def test_every_file_is_checked_even_where_the_first_is_wrong(run: Run, walk: Path) -> None:
    Path("bad.pddl").write_text(MISSPELT)
    result = run("check", "bad.pddl", "nosuch.pddl", "walk.pddl", "nosuch", ".", expect=1)
    assert "walk.pddl: right" in result.stdout
    assert "nosuch.pddl: there is no such file" in result.stderr
    assert "there is no task `nosuch`" in result.stderr
    assert ". is a folder" in result.stderr
    assert "5 domains: 1 right, 4 wrong, 0 warnings" in result.stdout


def test_warnings_do_not_fail(run: Run, folder: Path) -> None:
    Path("a.pddl").write_text("(define (domain a) (:predicates (p)))")
    result = run("check", "a.pddl")
    assert "warning: a.pddl:1:33: predicate `p` is declared" in result.stdout


def test_a_problem_is_checked_with_its_domain(run: Run, walk: Path) -> None:
    shown = run("check", "walk-problem.pddl").stdout
    assert "domain walk (walk.pddl, walk-problem.pddl)" in shown
    Path("walk-problem.pddl").write_text(WALK_PROBLEM.replace("(at home)", "(at hom)"))
    message = run("check", "walk-problem.pddl", expect=1).stderr
    assert "walk-problem.pddl:4:14: unknown object `hom`" in message


def test_a_domain_and_its_problem_are_one_check(run: Run, walk: Path) -> None:
    shown = run("check", "walk.pddl", "walk-problem.pddl").stdout
    assert shown.count(": right") == 1


def test_a_problem_of_any_name_is_checked_with_the_domain_it_names(run: Run, walk: Path) -> None:
    Path("p01.pddl").write_text(WALK_PROBLEM.replace("field", "meadow"))
    shown = run("check", "walk.pddl", "p01.pddl").stdout
    assert "domain walk (walk.pddl, walk-problem.pddl)" in shown
    assert "domain walk (walk.pddl, p01.pddl)" in shown
    Path("domain.pddl").write_text(WALK)
    assert "domain walk (domain.pddl, p01.pddl)" in run("check", "p01.pddl").stdout


def test_a_problem_without_a_domain_says_how_to_give_one(run: Run, folder: Path) -> None:
    Path("p01.pddl").write_text(WALK_PROBLEM)
    assert "serp check domain.pddl p01.pddl" in run("check", "p01.pddl", expect=1).stderr


def test_what_other_tools_refuse_is_a_warning(run: Run, walk: Path) -> None:
    walk.write_text(WALK.replace("(assign (walked) 0)", "(scale-down (walked) 2.0)"))
    shown = run("check", "walk.pddl").stdout
    assert "unified-planning reads it: no" in shown
    assert "warning: walk.pddl:15:18: unified-planning cannot read this" in shown


def test_nothing_to_check_is_a_usage_error(run: Run) -> None:
    run("check", expect=2)
