import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.errors import RunError
from serp.model.learned.transitions import TransitionMemory


def steps_of(count, seed=0):
    rng = np.random.default_rng(seed)
    steps = []
    for _ in range(count):
        state, after = rng.normal(size=(2, 3))
        after[rng.random(3) < 0.1] = rng.choice([np.nan, np.inf, -0.0])
        over = bool(rng.random() < 0.3)
        steps.append((state, int(rng.integers(-1, 4)), after, over, float(rng.normal())))
    return steps


def filled(steps, capacity):
    experience = TransitionMemory(capacity, 3, 4)
    for step in steps:
        experience.add(*step)
    return experience


def bits(experience):
    parts = experience.states, experience.actions, experience.next_states
    return tuple(part.tobytes() for part in (*parts, experience.over, experience.rewards))


@given(count=st.integers(0, 60), capacity=st.integers(1, 25))
def test_the_newest_transitions_are_kept_in_order_of_time(count, capacity):
    steps = steps_of(count)
    experience = filled(steps, capacity)
    kept = steps[-capacity:] if count else []
    assert len(experience) == len(kept)
    assert experience.seen == count
    states, actions, after, over, rewards = zip(*kept, strict=True) if kept else [[]] * 5
    np.testing.assert_array_equal(experience.states, np.reshape(states, (-1, 3)))
    np.testing.assert_array_equal(experience.actions, actions)
    np.testing.assert_array_equal(experience.next_states, np.reshape(after, (-1, 3)))
    np.testing.assert_array_equal(experience.over, over)
    np.testing.assert_array_equal(experience.rewards, rewards)


def test_a_saved_experience_that_does_not_fit_is_refused_and_changes_nothing():
    experience = filled(steps_of(30), 20)
    before = bits(experience)
    arrays, meta = filled(steps_of(25, seed=1), 20).state_dict()
    wrong = [
        (arrays, {**meta, "capacity": 21}),
        (arrays, {**meta, "seen": 12}),
        (arrays, {}),
        ({k: a for k, a in arrays.items() if k != "actions"}, meta),
        ({**arrays, "states": arrays["states"][:, :-1]}, meta),
        ({**arrays, "next_states": arrays["next_states"][:-1]}, meta),
        ({**arrays, "actions": arrays["actions"] + 1}, meta),
        ({**arrays, "over": arrays["over"] + np.int8(1)}, meta),
    ]
    for saved in wrong:
        with pytest.raises(RunError):
            experience.load_state_dict(*saved)
        assert bits(experience) == before
