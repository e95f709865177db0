"""A world made from a file does what the file says, and nothing where an action fails."""

from collections import Counter

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import serp
from serp.errors import SerpError
from serp.model.domain import Domain
from serp.pddl.source import Source
from serp.runs.diagnosis.diagnosis import diagnose
from serp.tasks.file_world import FileWorld, WorldOptions
from tests.serp.runs.runs import train
from tests.worlds import text

FERRY = text("one-way-ferry")
START = """(define (problem p) (:domain ferry)
  (:init (here) (= (clock) 0) (= (load) {load})) (:goal (there)))"""


def ferry(load=2):
    problem = Source("ferry-problem.pddl", START.format(load=load))
    return Domain.parse(Source("ferry.pddl", FERRY), problem)


@pytest.mark.filterwarnings("ignore:.*infinity:UserWarning")  # numbers of a file have no bounds
def test_a_step_is_that_of_the_file():
    world = FileWorld(ferry(), dt=0.5)
    check_env(world, skip_render_check=True)
    state, _ = world.reset(seed=0)
    for action, left in (("share", False), ("dive", False), ("cross", True)):
        number = world.model.action_index(action)
        expected = world.model.step(state, number)
        state, reward, terminated, truncated, info = world.step(number)
        assert (state == expected.state).all() and reward == expected.reward
        assert (terminated, truncated) == (expected.terminal, False) == (left, False)
        assert info == {"applied": True, "unsafe": action == "dive"}


def test_what_fails_or_cannot_be_done_changes_nothing_while_the_world_goes_on():
    world = FileWorld(ferry(), WorldOptions(failure=0.25))
    cross, waited = world.model.action_index("cross"), 0
    for seed in range(400):
        world.reset(seed=seed)
        state, reward, terminated, _, info = world.step(cross)
        values = world.model.values(state)
        assert values["clock"] == 1.0
        assert info["applied"] == values["there"] == terminated == (reward == 4.0)
        waited += not info["applied"]
    assert 75 < waited < 125
    world = FileWorld(ferry())
    world.reset()
    world.step(cross)
    state, reward, _, _, info = world.step(cross)
    assert (world.model.values(state)["clock"], reward, info["applied"]) == (2.0, -1.0, False)


def test_a_slip_is_another_action_that_can_be_done_and_noise_scales_changes():
    world, seen = FileWorld(ferry(), WorldOptions(slip=0.5)), Counter[int]()
    for seed in range(400):
        world.reset(seed=seed)
        *_, info = world.step(1)
        seen[world.happened.action] += 1
        assert info["applied"] == (world.happened.action == 1)
        first = world.happened.passages()[0].site.schema
        assert first.name == world.model.actions[world.happened.action].name
    assert sorted(seen) == [0, 1, 2] and 160 < seen[1] < 240 and 75 < seen[0] < 125

    world = FileWorld(ferry(), WorldOptions(noise=0.1), dt=0.5)
    ends, wait = [], world.model.action_index("dive")
    for seed in range(400):
        world.reset(seed=seed)
        world.step(wait)
        ends.append(world.model.values(world.state))
    clock = np.array([end["clock"] for end in ends]) / 0.5  # rises by dt
    assert abs(clock.mean() - 1.0) < 0.02 and 0.08 < clock.std() < 0.12
    assert all(end["load"] == 2 and end["here"] for end in ends)  # what does not change is exact


def test_a_run_is_opened_again_with_nothing_but_its_folder(tmp_path):
    file = tmp_path / "ferry.pddl"
    file.write_text(FERRY, encoding="utf-8")
    (tmp_path / "ferry-problem.pddl").write_text(START.format(load=2), encoding="utf-8")
    task = serp.file_task(file, slip=0.25, noise=0.5, max_steps=5, dt=0.5)
    out = train(task, tmp_path / "run", "paper", episodes=2).path
    file.unlink()
    run = serp.load_run(out)
    assert run.task.world == task.world and run.task.closed
    assert run.evaluate(episodes=2, quiet=True).returns
    more = serp.plan_and_learn("", out=out, resume=True, episodes=3, quiet=True)
    assert more.metrics["episode"][-1] == 3
    config = out / "config.json"
    config.write_text(config.read_text().replace('"slip": 0.25', '"slip": 1.25'))
    with pytest.raises(
        serp.RunError, match=r"config.json was not written.*slip must be less than 1"
    ):
        serp.load_run(out)


def test_a_world_whose_problem_has_a_metric_is_learned_in_and_diagnosed(tmp_path):
    for name in ("car", "car-problem"):
        (tmp_path / f"{name}.pddl").write_text(text(name), encoding="utf-8")
    task = serp.file_task(tmp_path / "car.pddl", noise=0.1, max_steps=5)
    out = train(task, tmp_path / "run", "default", episodes=2).path
    assert diagnose(out).verdict


def test_a_step_without_a_result_says_so():
    with pytest.raises(SerpError, match="world.failure must be less than 1"):
        serp.file_task(ferry(), failure=1.0)
    world = FileWorld(ferry(load=0))
    world.reset()
    with pytest.raises(SerpError, match="`share` has no result in .*not finite"):
        world.step(world.model.action_index("share"))
