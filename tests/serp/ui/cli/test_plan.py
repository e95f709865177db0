"""`serp plan`."""

import json
from pathlib import Path

import numpy as np
import pytest

import serp
from tests.worlds import text

EDGE = text("edge")


def planned(run, *arguments):
    shown = json.loads(run("plan", *arguments, "--json").stdout)
    account = shown.pop("account")
    return {**shown, "state": account["state"], "actions": account["alternatives"]}


def test_of_a_run_its_own_planner_and_model_are_shown(run, trained):
    agent = serp.load_run(trained).agent
    model, planner = agent.arbiter.model, agent.arbiter.planner
    state = model.values(np.array([0.0, 0.1, 0.02, -0.1]))
    given = ",".join(f"{name}={value}" for name, value in state.items())
    shown = planned(run, str(trained), "--state", given)
    found = planner.forecast(model.state(state))
    assert [action["best_return"] for action in shown["actions"]] == found.value.tolist()
    changes = shown["counterfactuals"]["changes"]
    assert changes == sorted(changes, key=lambda change: change["share"])
    for change in changes:
        changed = model.state({**state, change["fluent"]: change["becomes"]})
        other = model.actions[planner.forecast(changed).choice].name
        assert other == change["outcome"] != shown["action"]
    for wrong in ("--depth=3", "--domain=cartpole"):
        run("plan", str(trained), wrong, expect=2)
    assert "--domain cartpole" in run("plan", "cartpole", expect=2).stderr


def test_a_planner_is_chosen_by_its_name(run, folder):
    hall = EDGE.replace("(> (x) 3)", "(> (x) 99)").replace(" (reward)", "")
    (folder / "hall.pddl").write_text(hall)  # without a reward the goal is one
    (folder / "hall-problem.pddl").write_text(
        "(define (problem p) (:domain edge) (:init (= (x) 0)) (:goal (and (>= (x) 8))))"
    )
    near, far, same = (
        planned(run, "--domain", "hall.pddl", "--depth", "2", *planner)
        for planner in (("--planner", "lookahead"), ("--planner", "far-sight"), ())
    )
    assert same == far and [action["beyond"] for action in near["actions"]] == [0.0, 0.0]
    for action in far["actions"]:  # the goal lies beyond the steps that are shown
        assert action["beyond"] == pytest.approx(action["best_return"])
    assert (near["bound"], far["bound"]) == ("depth", "exhausted")
    assert far["action"] == "leap"
    drawn = run("plan", "--domain", "hall.pddl", "--svg=hall.svg").stderr
    assert "What the lookahead alone would choose is drawn in hall.svg" in drawn
    mistyped = run("plan", "--domain", "hall.pddl", "--planner", "far-sigt", expect=1)
    assert "did you mean `far-sight`" in mistyped.stderr


def test_a_given_state_adds_to_the_initial_one(run, tmp_path):
    Path("tank.pddl").write_text(
        "(define (domain tank) (:predicates (open) (on)) (:functions (level) (size))"
        " (:action fill :precondition (and (on) (< (level) (size)))"
        "  :effect (increase (level) 1))"
        " (:action start :precondition (open) :effect (on)))"
    )
    Path("tank-problem.pddl").write_text(
        "(define (problem p) (:domain tank) (:init (= (size) 4)) (:goal (>= (level) 2)))"
    )
    shown = planned(run, "--domain", "tank.pddl")
    assert (shown["state"], shown["actions"]) == ({"level": 0.0}, [])  # nothing can be reached
    shown = planned(run, "--domain", "tank.pddl", "--state", "open=1,level=1,size=2")
    assert shown["state"] == {"on": False, "level": 1.0}
    assert [step["action"] for step in shown["path"]] == ["start", "fill"]
    for state, said in (
        ("opn=1", "unknown fluent `opn`"),
        ("open=2", "`open` is true or false, not `2`"),
        ("level=nan", "`level` is a finite number, not `nan`"),
        ("level=1,level=2", "`level` is given twice"),
    ):
        assert said in run("plan", "--domain=tank.pddl", f"--state={state}", expect=1).stderr


def test_a_domain_of_no_task_needs_a_state(run, folder):
    Path("edge.pddl").write_text(EDGE)
    assert "the state is incomplete" in run("plan", "--domain=edge.pddl", expect=1).stderr
    assert "no task is installed for domain `edge`" in (
        run("plan", "--domain=edge.pddl", "--observe", expect=1).stderr
    )
    assert planned(run, "--domain=edge.pddl", "--state=x=0", "--depth=1")["state"] == {"x": 0}
