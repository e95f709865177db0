from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.errors import RunError
from serp.sysid.transitions import (
    CUT_OFF,
    GOES_ON,
    OVER,
    TransitionMemory,
)

Step = tuple[np.ndarray[Any, Any], int, np.ndarray[Any, Any], int, float]


def steps_of(count: int, fluents: int = 3, seed: int = 0, following: float = 0.8) -> list[Step]:
    """Steps of which most continue where the one before ended."""
    rng = np.random.default_rng(seed)
    state = rng.normal(size=fluents)
    steps: list[Step] = []
    for _ in range(count):
        after = rng.normal(size=fluents)
        after[rng.random(fluents) < 0.1] = rng.choice([np.nan, np.inf, -0.0])
        follows = bool(rng.random() < following)
        ending = GOES_ON if follows else int(rng.choice([CUT_OFF, OVER]))
        steps.append((state, int(rng.integers(-1, 4)), after, ending, float(rng.normal())))
        state = after if follows else rng.normal(size=fluents)
    return steps


def filled(steps: list[Step], capacity: int, fluents: int = 3) -> TransitionMemory:
    experience = TransitionMemory(capacity, fluents, 4)
    for step in steps:
        experience.add(*step)
    return experience


def bits(experience: TransitionMemory) -> tuple[bytes, ...]:
    parts = experience.states, experience.actions, experience.next_states
    ends = experience.ended, experience.over, experience.rewards
    return tuple(part.tobytes() for part in (*parts, *ends))


@given(count=st.integers(0, 60), capacity=st.integers(1, 25))
def test_the_newest_transitions_are_kept_in_order_of_time(count: int, capacity: int) -> None:
    steps = steps_of(count)
    experience = filled(steps, capacity)
    kept = steps[-capacity:] if count else []
    assert len(experience) == len(kept)
    assert experience.seen == count
    assert experience.states.shape == experience.next_states.shape == (len(kept), 3)
    np.testing.assert_array_equal(experience.states, [step[0] for step in kept] or np.empty((0, 3)))
    np.testing.assert_array_equal(experience.actions, [step[1] for step in kept])
    np.testing.assert_array_equal(
        experience.next_states, [step[2] for step in kept] or np.empty((0, 3))
    )
    np.testing.assert_array_equal(experience.ended, [step[3] != GOES_ON for step in kept])
    np.testing.assert_array_equal(experience.over, [step[3] == OVER for step in kept])
    np.testing.assert_array_equal(experience.rewards, [step[4] for step in kept])


@given(
    before=st.integers(0, 60),
    after=st.integers(0, 40),
    capacity=st.integers(1, 25),
    following=st.sampled_from([0.0, 0.8, 1.0]),
)
def test_resumed_equals_uninterrupted_bit_for_bit(
    before: int, after: int, capacity: int, following: float
) -> None:
    steps = steps_of(before + after, following=following)
    whole = filled(steps, capacity)
    resumed = filled([], capacity)
    resumed.load_state_dict(*filled(steps[:before], capacity).state_dict())
    for step in steps[before:]:
        resumed.add(*step)
    assert bits(resumed) == bits(whole)
    assert resumed.seen == whole.seen
    saved, again = whole.state_dict(), resumed.state_dict()
    assert again[1] == saved[1]
    assert {k: a.tobytes() for k, a in again[0].items()} == {
        k: a.tobytes() for k, a in saved[0].items()
    }


def test_what_is_added_is_copied() -> None:
    state, after = np.zeros(3), np.ones(3)
    experience = TransitionMemory(4, 3, 1)
    experience.add(state, 0, after, False)
    state[:] = after[:] = 7.0
    experience.states[:] = 9.0
    np.testing.assert_array_equal(experience.states, [[0.0, 0.0, 0.0]])
    np.testing.assert_array_equal(experience.next_states, [[1.0, 1.0, 1.0]])


def test_a_saved_experience_that_does_not_fit_is_refused_and_changes_nothing() -> None:
    experience = filled(steps_of(30), 20)
    before = bits(experience)
    arrays, meta = filled(steps_of(25, seed=1), 20).state_dict()
    wrong: list[tuple[dict[str, Any], dict[str, Any]]] = [
        (arrays, {**meta, "capacity": 21}),
        (arrays, {**meta, "seen": 12}),
        ({k: a for k, a in arrays.items() if k != "actions"}, meta),
        ({**arrays, "states": arrays["states"][:, :-1]}, meta),
        ({**arrays, "next_states": arrays["next_states"][:-1]}, meta),
        ({**arrays, "actions": arrays["actions"] + 1}, meta),
        ({**arrays, "endings": arrays["endings"] + np.int8(1)}, meta),
        (arrays, {}),
    ]
    for saved in wrong:
        with pytest.raises(RunError):
            experience.load_state_dict(*saved)
        assert bits(experience) == before
