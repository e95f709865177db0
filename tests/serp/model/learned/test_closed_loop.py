"""A planner that corrects its model while it acts, from files that say nothing or the reverse."""

import dataclasses

import pytest

from serp.runs.comparison.algorithms import find_algorithm
from serp.runs.trainer import Trainer
from serp.settings import resolve
from serp.tasks.registry import load_task
from tests.worlds import DOMAINS

SEEDS = (2000, 2001, 2002)


def returns(variant, seed, episodes):
    """Returns of the planner alone, which is worth about 10 without adaptation."""
    file = DOMAINS / f"cartpole-{variant}.pddl"
    task = dataclasses.replace(load_task("cartpole"), domain=file, problem=None)
    changes = {"adaptation": {"mode": "residual"}}
    settings = find_algorithm("mrp").changed("mrp", changes).settings(task, {})
    with task.bind() as bound:
        trainer = Trainer(bound, settings, seed)
        return [int(next(trainer.run()).return_) for _ in range(episodes)]


@pytest.mark.parametrize("seed", SEEDS)
def test_from_a_file_without_dynamics_the_pole_stands_in_the_first_episode(seed):
    assert returns("empty", seed, 1) == [500]


@pytest.mark.parametrize("seed", SEEDS)
def test_from_a_file_with_the_pushes_reversed_it_stands_by_the_second(seed):
    assert returns("reversed", seed, 2)[1] == 500


@pytest.mark.parametrize("seed", SEEDS)
def test_after_the_force_is_reversed_in_mid_run_it_stands_again_within_two_episodes(seed):
    task = load_task("cartpole")
    settings = resolve("default", task.settings, find_algorithm("mrp").changes)
    with task.bind() as bound:
        trainer = Trainer(bound, settings, seed)
        assert [next(trainer.run()).return_ for _ in range(3)] == [500] * 3
        cart = bound.env.unwrapped
        cart.force_mag = -cart.force_mag
        returns = [next(trainer.run()).return_ for _ in range(4)]
    assert returns[0] < 100 and returns[2:] == [500, 500]
