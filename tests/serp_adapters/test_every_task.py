"""Every shipped task and domain file fits together, with the observations that really come."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from click.testing import CliRunner

from serp.model.transition_model import Vector
from serp.runs.trainer import Trainer
from serp.settings import resolve
from serp.tasks.registry import find_task, load_task, task_entries
from serp.ui.root import serp
from tests.worlds import DOMAINS

VARIANTS = sorted(
    path.stem
    for path in DOMAINS.glob("*.pddl")
    if path.stem not in task_entries() and not path.stem.endswith("-problem")
)
"""Files beside a task's own, which know less of it or get it wrong."""
IGNORANT = ("swing-up", "hill", "landing")
"""Tasks whose files say what is wanted, and nothing of motion."""


class Step(NamedTuple):
    raw: Any
    state: Vector
    action: int
    """Of the environment."""
    ground: int
    reward: float
    after: Vector
    terminated: bool
    truncated: bool
    info: dict[str, Any]


def at_random(task, steps, seed, hold=1):
    """Steps of random actions, each held for up to `hold` steps."""
    rng = np.random.default_rng(seed)
    raw, _ = task.reset(seed=seed)
    left, ground = 0, 0
    for _ in range(steps):
        if not left:
            ground = int(rng.integers(len(task.model.actions)))
            left = int(rng.integers(1, hold + 1))
        left -= 1
        action = task.actions.environment_action[ground]
        state, before = task.ground(raw), raw
        raw, reward, terminated, truncated, info = task.step(action)
        after = task.ground(raw)
        yield Step(before, state, action, ground, reward, after, terminated, truncated, info)
        if terminated or truncated:
            raw, left = task.reset()[0], 0


@pytest.mark.parametrize("name", sorted(task_entries()))
def test_every_observation_is_a_state_every_step_is_judged_and_all_reproduce(name):
    with load_task(name).bind() as task:
        truths = [not fluent.numeric for fluent in task.model.fluents]
        steps = list(at_random(task, 150, 3))
        for step, again in zip(steps, at_random(task, 150, 3), strict=True):
            np.testing.assert_array_equal(step.raw, again.raw)
            assert step[4:5] + step[6:8] == again[4:5] + again[6:8]
            assert np.isfinite(step.state).all()
            assert np.isin(step.state[truths], (0.0, 1.0)).all()
            assert task.observation(step.raw).shape == (task.observation_size,)
            task.model.judge(step.state, step.ground, step.after)


@pytest.mark.parametrize("name", [*VARIANTS, *task_entries()])
def test_serp_learns_with_every_shipped_file(name):
    with find_task(str(DOMAINS / f"{name}.pddl") if name in VARIANTS else name).bind() as task:
        trainer = Trainer(task, resolve("default", task.task.settings), seed=1)
        assert next(trainer.run()).length >= 1


@pytest.mark.parametrize("name", sorted(path.stem for path in DOMAINS.glob("*.scenarios")))
def test_the_planner_does_what_the_scenarios_want(name):
    result = CliRunner().invoke(serp, ["test", str(DOMAINS / f"{name}.pddl")])
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize("name", VARIANTS)
def test_a_variant_differs_from_the_own_file_in_its_predictions_alone(name):
    """Who learns with a variant has the same words and rewards, and the same is unsafe."""
    with (
        find_task(str(DOMAINS / f"{name}.pddl")).bind() as variant,
        load_task(variant.name).bind() as full,
    ):
        assert variant.domain.name == name and name.startswith(f"{variant.name}-")
        assert variant.model.fluents == full.model.fluents
        assert [a.name for a in variant.model.actions] == [a.name for a in full.model.actions]
        assert variant.actions.environment_action == full.actions.environment_action
        assert variant.rewarded_by == full.rewarded_by
        steps = list(at_random(full, 1_500, 11))
        seen = [full.model.judge(s.state, s.ground, s.after) for s in steps]
        assert seen == [variant.model.judge(s.state, s.ground, s.after) for s in steps]
        assert {judged.unsafe for judged in seen} == {True, False}
        assert {judged.terminal for judged in seen} == {True, False}
        assert len({judged.reward for judged in seen}) > 2
        states = np.array([step.state for step in steps[:300]])
        outcomes = [
            [model.step(states, action) for action in range(len(full.model.actions))]
            for model in (variant.model, full.model)
        ]
        assert any(
            not (np.array_equal(x.state, y.state) and np.array_equal(x.reward, y.reward))
            for x, y in zip(*outcomes, strict=True)
        )


@pytest.mark.parametrize("name", IGNORANT)
def test_an_ignorant_file_says_what_is_wanted_and_nothing_of_what_happens(name):
    """Rewards are at most 0, so that nobody waits before the goal."""
    with find_task(name).bind() as task:
        steps = list(at_random(task, 3_000, 2, hold=6))
        rewards = set()
        for step in steps:
            judged = task.model.judge(step.state, step.ground, step.after)
            assert judged.terminal == step.terminated
            failed = step.info.get("crashed", False) or step.info.get("lost", False)
            assert judged.unsafe == failed
            rewards.add(judged.reward)
        assert any(step.terminated for step in steps) == (name != "swing-up")
        assert max(rewards) <= 0.0 and len(rewards) > 100
        assert not task.model.ground.processes
        states = np.array([step.state for step in steps[:200]])
        for action in range(len(task.model.actions)):
            outcome = task.model.step(states, action)
            np.testing.assert_array_equal(outcome.state, states)
            assert outcome.applicable.all()
