"""The symmetry that a task declares, resolved for its domain file and checked."""

import dataclasses
from typing import Any

import numpy as np
import pytest

import serp
from serp.errors import TaskError
from serp.runs.trainer import Trainer
from serp.settings import resolve
from serp.tasks.registry import load_task, task_entries
from serp.tasks.symmetry import check_grounding, resolved


@pytest.mark.parametrize("name", sorted(task_entries()))
def test_the_symmetries_of_shipped_tasks_hold_for_what_is_observed(name: str) -> None:
    with load_task(name).bind() as task:
        reflection, unfit = resolved(task)
        assert unfit is None
        assert (reflection is None) == (task.task.symmetry is None)
        rng = np.random.default_rng(5)
        raw, _ = task.reset(seed=5)
        for _ in range(50 if reflection else 0):
            check_grounding(task, reflection, task.observation(raw), task.ground(raw))
            raw, _, terminated, truncated, _ = task.step(int(rng.integers(task.actions.size)))
            if terminated or truncated:
                raw, _ = task.reset()


def cartpole(**declared: Any) -> serp.Task:
    symmetry = serp.Symmetry(**declared) if declared else None
    return dataclasses.replace(load_task("cartpole"), symmetry=symmetry)


def test_a_symmetry_that_observations_contradict_ends_a_training() -> None:
    task = cartpole(
        flip=("cart-position",),
        actions={"push-left": "push-right"},
        observation_signs=(-1, -1, -1, -1),
    )
    with task.bind() as bound, pytest.raises(TaskError, match=r"`cart-velocity`.*`symmetry`"):
        Trainer(bound, resolve(), 0).run_episode()


@pytest.mark.parametrize(
    ("declared", "message"),
    [
        ({"observation_signs": (-1, -1)}, "4 numbers"),
        ({"observation_signs": (-1, -1, 2, -1)}, "1 or -1"),
        ({"observation_order": (1, 2, 3, 0)}, "exchange pairs"),
        ({"actions": {0: 7}}, "no action 7"),
    ],
)
def test_a_wrong_declaration_is_refused(declared: dict[str, Any], message: str) -> None:
    with cartpole(**declared).bind() as task, pytest.raises(TaskError, match=message):
        resolved(task)


@pytest.mark.parametrize("declared", [{"actions": {"pull": "push-left"}}, {}])
def test_what_a_file_does_not_have_is_said_and_not_used(declared: dict[str, Any]) -> None:
    with cartpole(**declared).bind() as task:
        reflection, unfit = resolved(task)
    assert reflection is None
    assert (unfit is None) == (not declared)
    assert not declared or "`pull`" in str(unfit)


def test_the_preset_paper_does_not_use_it() -> None:
    with load_task("cartpole").bind() as task:
        assert Trainer(task, resolve("paper"), 0).agent.reflection is None
        assert Trainer(task, resolve(), 0).agent.reflection is not None
