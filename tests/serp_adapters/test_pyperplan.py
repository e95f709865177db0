"""Plans of pyperplan lead to the goal by the file's own model, and are followed to it."""

import functools
import itertools
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from serp.errors import SerpError
from serp.settings import PlannerSettings
from serp.tasks.file_world import FileWorld, WorldOptions
from serp_adapters.pyperplan.planner import Search, make
from serp_adapters.pyperplan.strips import Strips
from tests.generated import Texts, load_texts
from tests.generated.classical import blocks, gripper
from tests.worlds import text

HOUSE = Texts(text("house"), text("house-problem"))
GOAL = "(:goal (and (at d) (not (light))))"


def settings(name="pyperplan", most=10_000):
    return PlannerSettings(name=name, depth=2, max_nodes=most)


FILES = Path(__file__).parents[1] / "serp" / "model" / "pddl_files"
LOGISTICS = Texts(
    (FILES / "logistics.pddl").read_text(), (FILES / "logistics-problem.pddl").read_text()
)


@pytest.mark.parametrize(
    ("texts", "name"),
    [
        (blocks(6), "pyperplan:gbf:hadd"),
        (gripper(3), "pyperplan:astar:lmcut"),
        (LOGISTICS, "pyperplan"),
    ],
    ids=["blocks", "gripper", "logistics"],
)
def test_plans_are_followed_to_the_goal_while_actions_fail(texts, name):
    world = FileWorld(load_texts(texts), WorldOptions(failure=0.1))
    planner = make(world.model, settings(name))
    state, _ = world.reset(seed=0)
    for _ in range(100):
        state, _, terminated, _, _ = world.step(planner.forecast(state).choice)
        if terminated:
            break
    assert terminated and planner.searches == 1


@functools.cache
def house():
    return load_texts(HOUSE, observed=True).model


def test_operators_are_what_the_file_does_without_harm():
    """In every state: applicable actions, all safe ones, with the effects of the model."""
    model = house()
    strips = Strips(model.ground, "pyperplan")
    names = [fluent.name for fluent in model.fluents if not fluent.numeric]
    for values in itertools.product((0.0, 1.0), repeat=len(names)):
        state = model.state({"battery": 3.0, **dict(zip(names, values, strict=True))})
        holding, done = strips.holding(state), set()
        for operator in strips.operators:
            if operator.needs <= holding:
                out, flags = model.transition(state.tolist(), operator.action)
                after = (holding - operator.deletes) | operator.adds
                burnt = any(way <= after for way in (*strips.unsafe, *strips.ends))
                assert flags & 1 and bool(flags & 2) == burnt
                assert after == strips.holding(np.array(out[:-1]))
                done.add(operator.action)
        for action in range(len(model.actions)):
            out, flags = model.transition(state.tolist(), action)
            if flags & 1 and not flags & 2 and strips.holding(np.array(out[:-1])) != holding:
                assert action in done


@pytest.mark.parametrize("name", ["bfs", "ids", "astar:hmax", "wastar:landmark", "ehs", "gbf:hsa"])
def test_a_plan_keeps_away_from_what_is_unsafe(name):
    model = house()
    start = model.initial_state
    plan = Search(model, settings(f"pyperplan:{name}")).plan(start)
    way = [model.actions[action].name for action in plan]
    assert sorted(way) == ["go a c", "go c d", "toggle", "toggle"]
    moon = model.state(model.values(start) | {"moon": True})
    assert Search(model, settings(f"pyperplan:{name}")).plan(moon) == [model.action_index("jump a")]


def print_plans():
    model = load_texts(blocks(5, 3)).model
    for name in ("gbf:hff", "wastar:lmcut", "astar:landmark"):
        print(Search(model, settings(f"pyperplan:{name}")).plan(model.initial_state))


def test_a_search_is_the_same_in_every_process(capsys):
    """The order of texts in sets differs between processes, and so do addresses."""
    program = "from tests.serp_adapters.test_pyperplan import print_plans; print_plans()"
    other = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    print_plans()
    here = capsys.readouterr().out
    assert other.stdout.decode().splitlines() == here.splitlines() and "None" not in here


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("pyperplan:dfs", "", "", "there is no search `dfs`; did you mean"),
        ("pyperplan:astar:lmcat", "", "", "no heuristic `lmcat`; did you mean `lmcut`"),
        ("pyperplan:bfs:hff", "", "", "takes no heuristic; write `pyperplan:bfs`"),
        ("pyperplan:gbf:hff:1", "", "", "write `pyperplan:SEARCH:HEURISTIC`"),
        ("pyperplan", GOAL, "", r"generated.pddl:1:1: .*has no goal"),
        ("pyperplan", "(at ?p) (next", "(> (battery) 0) (next", "a number decides(?s:.*)up:enhsp"),
        ("pyperplan", "(hot ?r)) :effect (unsafe)", "(hot ?r)) :effect (light)", "knows no events"),
    ],
)  # fmt: skip
def test_what_it_cannot_do_is_said_with_advice(name, old, new, message):
    problem = HOUSE.problem or ""
    changed = Texts(HOUSE.domain.replace(old, new), problem.replace(old, new))
    with pytest.raises(SerpError, match=message):
        make(load_texts(changed if old else HOUSE).model, settings(name))
