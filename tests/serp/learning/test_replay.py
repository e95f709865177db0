"""The replay memory by its definition: n-step samples, draws."""

from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp import _core
from serp.learning.replay import ReplayBuffer
from serp.settings import LearnerSettings

F, A = 2, 3
DISCOUNT = 0.9


@dataclass(frozen=True)
class Step:
    """One env step; its observation is its number in the stream, so that it can be told apart."""

    number: int
    action: int = 0
    reward: float = 0.0
    terminated: bool = False
    truncated: bool = False

    @property
    def imitated(self):
        return self.number % 4 - 1

    @property
    def allowed(self):
        return self.number % 2**A


def feed(buffer, steps, env_index=0):
    for step in steps:
        buffer.add(
            np.array([step.number, 0], np.float32),
            step.action,
            step.reward,
            np.array([step.number, 1], np.float32),
            step.terminated,
            step.truncated,
            step.imitated,
            env_index,
            np.array([step.allowed >> k & 1 for k in range(A)], bool),
        )


@st.composite
def streams(draw):
    kinds = st.tuples(
        st.integers(0, A - 1),
        st.floats(-2, 2, width=16),
        st.sampled_from(["goes on"] * 6 + ["terminated", "truncated", "both"]),
    )
    return [
        Step(i, a, r, end in ("terminated", "both"), end in ("truncated", "both"))
        for i, (a, r, end) in enumerate(draw(st.lists(kinds, max_size=60)))
    ]


def buffer(**changes):
    settings = LearnerSettings(**{"buffer_size": 50, "n_step": 1, **changes})
    return ReplayBuffer(F, A, settings, np.random.default_rng(0), DISCOUNT)


def episodes(steps):
    found = [[]]
    for step in steps:
        found[-1].append(step)
        if step.terminated or step.truncated:
            found.append([])
    return found


def expected_samples(steps, n):
    """Return the n-step samples by their definition, one episode at a time."""
    samples = []
    for episode in episodes(steps):
        ended = bool(episode) and (episode[-1].terminated or episode[-1].truncated)
        for i, step in enumerate(episode):
            window = episode[i : i + n]
            if len(window) < n and not ended:
                break
            last = window[-1]
            reward = sum(DISCOUNT**k * s.reward for k, s in enumerate(window))
            samples.append(
                (
                    [step.number, 0],
                    step.action,
                    pytest.approx(reward, abs=1e-5),
                    [last.number, 1],
                    pytest.approx(0.0 if last.terminated else DISCOUNT ** len(window), abs=1e-6),
                    step.imitated,
                    [last.allowed],
                )
            )
    return samples


def rows_of(arrays):
    return list(zip(*(array.tolist() for array in arrays.values()), strict=True))


def stored(memory, capacity):
    """Return the samples, from the oldest on."""
    arrays, meta = memory.state_dict()
    rows = rows_of({k: a for k, a in arrays.items() if k != "pending.observation"})
    start = meta["head"] if len(rows) == capacity else 0
    return rows[start:] + rows[:start]


@settings(deadline=None)
@given(steps=streams(), n=st.integers(1, 5), capacity=st.integers(1, 30))
def test_the_ring_holds_the_newest_n_step_samples(steps, n, capacity):
    ring = buffer(n_step=n, buffer_size=capacity)
    feed(ring, steps)
    expected = expected_samples(steps, n)
    assert stored(ring, capacity) == expected[-capacity:]
    assert ring.size == min(len(expected), capacity)


@settings(deadline=None)
@given(first=streams(), second=streams(), n=st.integers(1, 5))
def test_the_steps_of_two_environments_do_not_mix(first, second, n):
    lanes = [
        [replace(s, number=s.number + at) for s in (*steps, Step(len(steps), truncated=True))]
        for at, steps in ((0, first), (1000, second))
    ]
    ring = buffer(n_step=n, buffer_size=200)
    for pair in zip_longest(*lanes):
        for env_index, step in enumerate(pair):
            feed(ring, [] if step is None else [step], env_index)
    found = stored(ring, 200)
    assert [s for s in found if s[0][0] < 1000] == expected_samples(lanes[0], n)
    assert [s for s in found if s[0][0] >= 1000] == expected_samples(lanes[1], n)


def test_draws_are_uniform():
    memory = buffer(buffer_size=10, n_step=2)
    feed(memory, [Step(i) for i in range(5)])
    counts = np.bincount(memory.draw(8000))
    assert len(counts) == memory.size == 4
    assert np.abs(counts - 2000).max() < 5 * 2000**0.5


@pytest.mark.parametrize(
    ("field", "values", "message"),
    [
        (None, [4] * 8, "no such sample"),
        (None, [-1] * 8, "no such sample"),
        (None, [0] * 7, "do not fit the network"),
        ("action", A, "out of range"),
        ("action", -1, "out of range"),
        ("imitated", A, "out of range"),
    ],
)
def test_compiled_code_reads_nothing_outside_of_the_arrays(field, values, message):
    store = buffer(buffer_size=4)
    drawn = np.array(values if field is None else [3] * 8)
    if field is not None:
        store.samples[field][3] = values
    learning = _core.QLearning((F, A), False, 1, 8, 0.1, np.inf, None)
    learning.online.parameters[0, 0] = learning.online.parameters[0, -1] = 1.0
    with pytest.raises(ValueError, match=message):
        learning.update(store.compiled, drawn, 1.0)
    assert learning.steps == 0


def test_compiled_code_takes_no_fields_of_different_lengths():
    fields = buffer().samples
    with pytest.raises(ValueError, match="other shapes"):
        _core.ReplaySamples(**fields | {"reward": fields["reward"][1:].copy()})
