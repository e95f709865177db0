"""`serp plan`."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import serp
from serp.errors import SerpError
from serp.model.domain import Domain
from serp.ui.asked import parse_state
from tests.serp.sample_tasks import CORRIDOR
from tests.serp.ui.cli.conftest import Run

EDGE = """
(define (domain edge)
  (:predicates (unsafe))
  (:functions (x) (reward))
  (:action step :parameters () :precondition (< (x) 9) :effect (and (increase (x) 1)))
  (:action leap :parameters () :precondition (< (x) 9) :effect (and (increase (x) 2)))
  (:event fall :parameters () :precondition (and (> (x) 3)) :effect (and (unsafe))))
"""


def planned(run: Run, *arguments: str) -> Any:
    shown = json.loads(run("plan", *arguments, "--json").stdout)
    account = shown.pop("account")
    return {**shown, "state": account["state"], "actions": account["alternatives"]}


def test_of_a_run_its_own_planner_and_model_are_shown(run: Run, trained: Path) -> None:
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


def test_a_planner_is_chosen_by_its_name(run: Run, folder: Path) -> None:
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


def test_a_given_state_adds_to_the_initial_one(run: Run, tmp_path: Path) -> None:
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
    with pytest.raises(AssertionError, match="unknown fluent `opn`"):
        planned(run, "--domain", "tank.pddl", "--state", "opn=1")


def test_json_is_what_the_planner_says(run: Run, walk: Path) -> None:
    model = serp.load_domain(walk).model
    state = model.initial_state
    assert state is not None
    planner = serp.MonitorReplanner(model, depth=4, discount=0.8)
    plan = planner.plan(state)
    shown = planned(
        run, "--domain=walk.pddl", "--depth=4", "--set=planner.discount=0.8", "--planner=lookahead"
    )
    assert shown["state"] == model.values(state)
    own = {"action": plan.name, "best_return": plan.reward, "bound": "depth", "nodes": plan.nodes}
    assert {name: shown[name] for name in own} == own
    assert [step["action"] for step in shown["path"]] == [step.action for step in plan.path]
    assert [step["state"] for step in shown["path"]] == [model.values(s.state) for s in plan.path]
    for action, value in zip(shown["actions"], plan.forecast.value.tolist(), strict=True):
        assert action["best_return"] == (value if action["applicable"] else None)


def test_a_domain_of_no_task_needs_a_state(run: Run, folder: Path) -> None:
    Path("edge.pddl").write_text(EDGE)
    assert "which state?" in run("plan", "--domain=edge.pddl", expect=1).stderr
    assert "no task is installed for domain `edge`" in (
        run("plan", "--domain=edge.pddl", "--observe", expect=1).stderr
    )
    assert planned(run, "--domain=edge.pddl", "--state=x=0", "--depth=1")["state"] == {"x": 0}


MILD = CORRIDOR.replace("(unsafe) (terminal)", "(terminal)")
KNOWN = """
(define (domain known)
  (:constants robot1 kitchen)
  (:predicates (at ?who ?where))
  (:functions (x))
  (:action go :effect (and (at robot1 kitchen) (increase (x) 1))))
"""


def planned_in(run: Run, folder: Path, text: str) -> Any:
    (folder / "my_corridor.py").write_text(
        "from pathlib import Path\nfrom tests.serp.sample_tasks import corridor\n"
        "def task(): return corridor(Path('.'))\n"
    )
    (folder / "own.pddl").write_text(text)
    arguments = ("--task=my_corridor:task", "--set=planner.name=lookahead", "--depth=1", "--json")
    return json.loads(run("plan", *arguments, "--domain=own.pddl").stdout)


def test_where_the_planner_is_indifferent_the_next_state_is_tried(run: Run, folder: Path) -> None:
    """Far from goal and pit nothing differs; the walk goes left until the pit is near."""
    shown = planned_in(run, folder, MILD)
    assert not shown["indifferent"] and " without a choice" in shown["state_from"]
    stuck = CORRIDOR.replace(":precondition (and)", ":precondition (and (> (x) 99))")
    assert planned_in(run, folder, stuck)["state_from"] == "observed after a reset with seed 0"


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Domain:
    file = tmp_path_factory.mktemp("known") / "known.pddl"
    file.write_text(KNOWN)
    return serp.load_domain(file)


def test_fluents_are_named_as_pddl_has_them(known: Domain) -> None:
    state = parse_state(["X=1.5,( at  Robot1 kitchen )=true"], known)
    assert state == {"x": 1.5, "at robot1 kitchen": 1.0}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("at robot1 kitche=1", "did you mean `at robot1 kitchen`?"),
        ("x=nan", "`x` is a finite number, not `nan`"),
        ("at robot1 kitchen=2", "`at robot1 kitchen` is true or false, not `2`"),
        ("x=1,x=2", "`x` is given twice"),
    ],
)
def test_wrong_fluents_are_named(known: Domain, text: str, message: str) -> None:
    with pytest.raises(SerpError) as error:
        parse_state([text], known)
    assert message in str(error.value)
