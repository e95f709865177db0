"""Files that claim to leave nothing out predict every step of their environments exactly."""

import dataclasses
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.tasks.registry import load_task
from serp_adapters import frozen_lake

NOTHING = 6  # an action of MiniGrid


def check_step(task, before, action, answer):
    """Compare a step (observation, reward, end) with the file; return if it was applicable.

    Where the file says that an action is not applicable, the environment changes nothing.
    """
    after, reward, terminated = answer[:3]
    state, seen = task.ground(before), task.ground(after)
    instances = [k for k, a in enumerate(task.actions.environment_action) if a == action]
    outcomes = [task.model.step(state, k) for k in instances]
    applicable = [outcome for outcome in outcomes if outcome.applicable]
    if not applicable:
        assert (seen == state).all() and not terminated
        return False
    (predicted,) = applicable
    assert predicted.state.tolist() == seen.tolist()
    assert predicted.terminal == terminated
    assert predicted.reward == reward
    return True


# Tables of Gymnasium -----------------------------------------------------------------------------


def dry_lake():
    """The lake without the slipping, which its file leaves out."""
    firm = partial(frozen_lake.make_env, is_slippery=False)
    return dataclasses.replace(frozen_lake.task(), make_env=firm).bind()


def during_episodes(env):
    """The states of a table that an episode can be in before it ends."""
    found = set()
    waiting = np.flatnonzero(env.initial_state_distrib).tolist()
    while waiting:
        state = waiting.pop()
        if state not in found:
            found.add(state)
            rows = env.P[state].values()
            waiting += [after for row in rows for _, after, _, ended in row if not ended]
    return found


@pytest.mark.parametrize(
    ("make", "states", "applicable"),
    # A passenger is at one of four places and wants to go to one of the others, or is aboard. There
    # are 68 ways from a square to the next, and both passenger and taxi have to be at a place.
    [
        (load_task("taxi").bind, 25 * (12 + 4), 68 * (12 + 4) + 12 + 16),
        (dry_lake, 64 - 11, 4 * (64 - 11)),
    ],
    ids=["taxi", "frozen-lake"],
)
def test_every_entry_of_the_table_is_predicted(make, states, applicable):
    found = 0
    with make() as task:
        env = task.env.unwrapped
        during = during_episodes(env)
        assert len(during) == states
        for state in during:
            for action, [(_, after, reward, terminated)] in env.P[state].items():
                found += check_step(task, state, action, (after, reward, terminated))
    assert found == applicable


# Grids -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=["door-key", "four-rooms"])
def grid_task(request):
    with load_task(request.param).bind() as bound:
        yield bound


def free_cells(env):
    """Cells where a robot can be while an episode goes on."""
    grid = env.unwrapped.grid
    things = {(x, y): grid.get(x, y) for x, y in np.ndindex(grid.width, grid.height)}
    return [
        cell
        for cell, thing in things.items()
        if thing is None or (thing.can_overlap() and thing.type != "goal")
    ]


def fetch_key(env, *, opened):
    """Give the robot the key, and open the door if asked."""
    for x, y in np.ndindex(env.grid.width, env.grid.height):
        thing = env.grid.get(x, y)
        if thing is not None and thing.type == "key":
            env.carrying = thing
            env.grid.set(x, y, None)
        elif thing is not None and thing.type == "door" and opened:
            thing.is_locked, thing.is_open = False, True


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10_000),
    stage=st.sampled_from(["begun", "has the key", "opened the door"]),
    where=st.randoms(use_true_random=False),
)
def test_every_step_on_a_grid_is_predicted(grid_task, seed, stage, where):
    """Of the environment's reward, which falls with time, only whether there is one."""
    grid_task.reset(seed=seed)
    env = grid_task.env.unwrapped
    if stage != "begun":
        fetch_key(env, opened=stage == "opened the door")
    for _ in range(20):
        env.agent_pos, env.agent_dir = where.choice(free_cells(env)), where.randrange(4)
        before = grid_task.step(NOTHING)[0]
        for action in where.choices(sorted(set(grid_task.actions.environment_action)), k=2):
            after, reward, terminated, truncated, _ = grid_task.step(action)
            check_step(grid_task, before, action, (after, float(reward > 0), terminated))
            if terminated or truncated:
                return
            before = after
