"""The slippery cliff: what the wrapper shows is what Gymnasium's table says, falls included."""

import gymnasium as gym
import numpy as np
import pytest

from serp_adapters import cliff
from tests.serp_adapters.test_every_task import at_random

CLIFF = range(37, 47)
GOAL = 47
# What slips are: the moves to the left and to the right of the one that is meant.
MOVES = ((-1, 0), (0, 1), (1, 0), (0, -1))


@pytest.fixture(scope="module")
def task():
    return cliff.task().bind()


@pytest.fixture(scope="module")
def table():
    """Gymnasium's: cell → action → (probability, next cell, reward, whether it ends)."""
    return gym.make("CliffWalkingSlippery-v1").unwrapped.P


def moved(cell, action):
    """The cell that a move leads to, on a plateau with a wall round it."""
    row, column = divmod(cell, 12)
    down, right = MOVES[action]
    return 12 * min(max(row + down, 0), 3) + min(max(column + right, 0), 11)


def test_every_step_is_one_of_gymnasiums_table_and_a_fall_shows_its_cell(task, table):
    """Gymnasium puts fallen robots back to the start; the slips are a third of the moves each."""
    falls, slips = set(), np.zeros(3)
    for step in at_random(task, 20_000, 1):
        cell, action, reward, terminated = step.raw, step.action, step.reward, step.terminated
        row, column = task.model.values(step.after)["row"], task.model.values(step.after)["column"]
        shown = int(12 * row + column)
        possible = {(n, r, t) for _, n, r, t in table[cell][action]}
        ways = [moved(cell, (action + slip) % 4) for slip in (-1, 0, 1)]
        fell = shown in CLIFF
        assert step.info["falls"] == fell
        if fell:
            assert (36, -100, False) in possible
            assert (reward, terminated) == (-100.0, True)
            assert shown in ways
            falls.add((cell, action, shown))
        else:
            assert (shown, reward, terminated) in possible
        if len(set(ways)) == 3:
            slips[ways.index(shown)] += 1
        judged = task.model.judge(step.state, step.ground, step.after)
        assert (judged.terminal, judged.unsafe) == (terminated, fell)
    # From the start, slipping and not, and from above.
    assert {(36, 0, 37), (36, 1, 37)} <= falls
    assert len({fallen for cell, _, fallen in falls if cell != 36}) >= 3
    assert slips.sum() > 3_000
    np.testing.assert_allclose(slips / slips.sum(), 1 / 3, atol=0.03)
    assert task.model.judge(task.ground(35), 2, task.ground(GOAL))[1:] == (False, True)


def test_the_domain_moves_as_the_environment_does_without_slipping(task):
    for cell in range(48):
        for action in range(4):
            ground = task.model.action_index(task.actions.name(action))
            predicted = task.model.step(task.ground(cell), ground)
            there = moved(cell, action)
            assert predicted.state.tolist() == task.ground(there).tolist()
            assert predicted.unsafe == (there in CLIFF)
            assert predicted.terminal == (there in CLIFF or there == GOAL)
