"""Engines of unified-planning as planners."""

import functools
import json
import random
import re
import signal
import subprocess
import weakref
from importlib.util import find_spec
from pathlib import Path

import pytest
from unified_planning.engines.sequential_simulator import UPSequentialSimulator

from serp.errors import Notice, SerpError
from serp.model.domain import load_domain
from serp.model.transition_model import TransitionModel
from serp.planning.plan_follower import PlanFollower
from serp.settings import PlannerSettings
from serp_adapters.unified_planning import planner, worker
from serp_adapters.unified_planning.translation import translated, values_in
from serp_adapters.unified_planning.worker import Planning, Refused, begin_at, problem_of
from tests.generated import Texts, load_texts
from tests.generated.classical import blocks
from tests.worlds import text

FILES = Path(__file__).parents[2] / "serp" / "model" / "pddl_files"
ROVER = text("science-rover")
START = """
(define (problem p) (:domain rover)
  (:init (at a) (icy b) (link a b) (link b c) (= (charge) 3) (= (load) 0)) (:goal (and)))
"""


@functools.cache
def rover(event="(unsafe)", more=""):
    domain = ROVER.replace("(and (unsafe))", f"(and {event})")
    return load_texts(Texts(domain.replace("(:event home", f"{more}(:event home"), START)).model


def model_of(name):
    return rover() if name == "rover" else load_domain(FILES / f"{name}.pddl").model


def sent(model):
    """The problem as another process receives it."""
    return json.loads(json.dumps(translated(model)))


@pytest.mark.parametrize("name", ["rover", "briefcase", "counters"])
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_translated_problem_steps_as_the_model_does(name):
    model = model_of(name)
    task = sent(model)
    problem, start = problem_of(task), model.initial_state
    columns = {k: v for k, v in task["fluents"].items() if v[0] >= 0}
    begin_at(problem, values_in(task, start))
    simulator = UPSequentialSimulator(problem, error_on_failed_checks=False)
    actions = [problem.action(f"a{k}") for k in range(len(model.actions))]
    rng = random.Random(1)
    for _ in range(12):
        ours, theirs = start, simulator.get_initial_state()
        ended = False
        while not ended:
            following = []
            for k, action in enumerate(actions):
                outcome, after = model.step(ours, k), simulator.apply(theirs, action)
                failed = outcome.unsafe or (outcome.terminal and not outcome.reward > 0.0)
                if failed and after is not None:  # an event's doing: there is nothing to do then
                    assert not simulator.is_goal(after)
                    assert all(simulator.apply(after, other) is None for other in actions)
                elif not failed:
                    assert (after is not None) == outcome.applicable, model.actions[k].name
                if after is None or failed:
                    continue
                assert simulator.is_goal(after) == outcome.terminal
                for fluent, (column, _) in columns.items():
                    value = after.get_value(problem.fluent(fluent)()).constant_value()
                    assert float(value) == outcome.state[column], model.fluents[column].name
                following.append((outcome, after))
            outcome, theirs = rng.choice(following) if following else (None, theirs)
            ended = outcome is None or outcome.terminal or rng.random() < 0.1
            ours = None if outcome is None else outcome.state


def play(model, name):
    """Follow a planner to the end, while every third action fails."""
    model = TransitionModel(model.ground)
    follower = planner.make(model, PlannerSettings(name=name))
    state, steps = model.initial_state, 0
    while True:
        outcome = model.step(state, follower.forecast(state).choice)
        assert not outcome.unsafe
        steps += 1
        if steps % 3:
            state = outcome.state
            if outcome.terminal:
                assert outcome.reward > 0.0
                return follower


def test_a_plan_is_followed_to_the_goal_and_an_engine_that_takes_too_long_is_ended(monkeypatch):
    follower = play(model_of("logistics"), "up:pyperplan")
    assert (follower.searches, len(follower.plan)) == (1, 11)
    state, find_plan = follower.model.initial_state, follower._find_plan
    assert state is not None and isinstance(find_plan, planner.EnginePlans)
    process = find_plan._process
    find_plan.model.revision = 1  # the same process plans with another model
    assert find_plan(state) is not None and find_plan._process is process
    monkeypatch.setattr(find_plan, "seconds", 0.05)
    monkeypatch.setattr(planner, "_GRACE", 0.05)
    process.send_signal(signal.SIGSTOP)  # it hangs
    with pytest.warns(Notice, match="found no plan .no answer in 0.1 seconds"):
        assert find_plan(state) is None
    monkeypatch.undo()
    found = find_plan(state)
    assert found is not None and len(found) == 11


def test_a_training_goes_on_with_the_built_in_planner_where_an_engine_dies_or_tears_a_line():
    model, settings = model_of("logistics"), PlannerSettings()
    plans, state = planner.EnginePlans(model, "pyperplan", 5.0), model.initial_state
    plans._end()
    for script, why in (
        ("read x; kill -9 $$", "exit status -9; not enough memory?"),
        ("read x; printf '{\"plan\": [0'", "exit status 0"),
        ("read x; echo '{\"plan\": [99999]}'; cat", "which is not an answer"),
        ("read x; echo 'Traceback'; cat", "which is not an answer"),
    ):
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        plans._process = process = subprocess.Popen(["sh", "-c", script], **pipes)
        plans._finalizer = weakref.finalize(plans, planner._finish, process)
        plans._told = False
        with pytest.warns(Notice, match=re.escape(why)):
            assert PlanFollower(model, settings, plans).forecast(state).choice >= 0
        assert plans._process is None and process.returncode is not None
    assert plans(state) is not None  # by another process


def test_an_engine_ends_with_its_parent():
    model = TransitionModel(load_texts(blocks(14)).model.ground)
    plans = planner.EnginePlans(model, "pyperplan-opt", 60.0)
    process, state = plans._process, model.initial_state
    assert process is not None and process.stdin is not None and state is not None
    question = {"state": values_in(plans._task, state), "seconds": 60.0}
    process.stdin.write(json.dumps(question) + "\n")
    process.stdin.close()  # as where the parent is killed
    assert process.wait(10.0) == 1


WARD = text("ward")


def test_an_engine_without_disjunctions_heeds_conditions_that_hold_together(monkeypatch):
    start = "(at a) (wet b) (lit) (next a b) (next b c)"
    problem = f"(define (problem p) (:domain ward) (:init {start}) (:goal (at c)))"
    model = load_texts(Texts(WARD, problem)).model
    follower = play(model, "up:pyperplan")
    names = [model.actions[action].name for action in follower.plan]
    assert names == ["wait", "wait", "go a b", "go b c"]
    monkeypatch.setattr(worker, "MOST_VARIANTS", 5)
    with pytest.raises(Refused, match=r"gives \d+ actions, more than 5. .* such as `enhsp`"):
        Planning("pyperplan", sent(model))


@pytest.mark.skipif(find_spec("up_enhsp") is None, reason="up-enhsp is not installed")
def test_a_numeric_plan_heeds_what_events_do():
    assert play(rover(), "up:enhsp").searches == 1


JUMP = """(:action jump :parameters () :precondition (and (> (sqrt (charge)) 2))
    :effect (and (increase (charge) 1)))"""
PROCESS = """(:process melt :parameters () :precondition (and)
    :effect (and (decrease (charge) (* #t 1))))"""


@pytest.mark.parametrize(
    ("name", "event", "more", "message"),
    [
        ("up:pyperplan:soon", "(unsafe)", "", "`up:pyperplan:soon` should end with a positive"),
        ("up:pyperplan", "(increase (load) 1)", "", r"know no event that changes fluents\n"),
        ("up:pyperplan", "(unsafe)", JUMP, r"do not know `sqrt`\n"),
        ("up:pyperplan", "(unsafe)", PROCESS, r"know no time that passes between actions\n"),
    ],
)
def test_what_no_engine_can_plan_is_refused_with_its_place(name, event, more, message):
    with pytest.raises(SerpError, match=message):
        planner.make(rover(event, more), PlannerSettings(name=name))
