"""The replay memory by its definition: n-step samples, draws."""

from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp import _core
from serp.learning.replay import ReplayBuffer, Samples, SampleSpec
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
    allowed: tuple[bool, ...] | None = None

    @property
    def imitated(self):
        return self.number % 4 - 1


def feed(buffer, steps):
    for step in steps:
        buffer.add(
            np.array([step.number, 0], np.float32),
            step.action,
            step.reward,
            np.array([step.number, 1], np.float32),
            step.terminated,
            step.truncated,
            None if step.allowed is None else np.array(step.allowed),
            step.imitated,
        )


@st.composite
def streams(draw):
    kinds = st.tuples(
        st.integers(0, A - 1),
        st.floats(-2, 2, width=16),
        st.sampled_from(["goes on"] * 6 + ["terminated", "truncated", "both"]),
        st.none() | st.tuples(*[st.booleans()] * A),
    )
    return [
        Step(i, a, r, end in ("terminated", "both"), end in ("truncated", "both"), mask)
        for i, (a, r, end, mask) in enumerate(draw(st.lists(kinds, max_size=60)))
    ]


def buffer(
    spec=SampleSpec(F, A, imitates=True),  # noqa: B008
    **changes,
):
    usual = {
        "buffer_size": 50, "batch_size": 8, "n_step": 1,
    }  # fmt: skip
    settings = LearnerSettings(**{**usual, **changes})
    return ReplayBuffer(spec, settings, np.random.default_rng(0), DISCOUNT)


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
            forbidden = [not allowed for allowed in (last.allowed or (True,) * A)]
            samples.append(
                (
                    [step.number, 0],
                    step.action,
                    pytest.approx(reward, abs=1e-5),
                    [last.number, 1],
                    pytest.approx(0.0 if last.terminated else DISCOUNT ** len(window), abs=1e-6),
                    forbidden if not all(forbidden) else [False] * A,
                    step.imitated,
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
        for ring.env_index, step in enumerate(pair):
            feed(ring, [] if step is None else [step])
    found = stored(ring, 200)
    assert [s for s in found if s[0][0] < 1000] == expected_samples(lanes[0], n)
    assert [s for s in found if s[0][0] >= 1000] == expected_samples(lanes[1], n)


def flat(batch):
    """Return the samples of all members of a batch."""
    return rows_of({k: a.reshape(-1, *a.shape[2:]) for k, a in batch.arrays().items()})


def test_draws_are_uniform_whole_samples_and_differ_between_members():
    memory = buffer(batch_size=32, members=3, buffer_size=10, n_step=2)
    feed(memory, [Step(i, i % A, i / 2, i % 6 == 5) for i in range(17)])
    by_number = {sample[0][0]: sample for sample in stored(memory, 10)}
    counts = dict.fromkeys(by_number, 0)
    first = memory.sample()
    for _ in range(200):
        batch = memory.sample()
        assert batch is first  # nothing is allocated
        assert batch.observation.shape == (3, 32, F)
        assert not np.array_equal(batch.observation[0], batch.observation[1])
        for sample in flat(batch):
            counts[sample[0][0]] += 1
            assert sample == by_number[sample[0][0]]
    expected = 200 * 96 / len(counts)
    assert all(abs(count - expected) < 5 * expected**0.5 for count in counts.values())


@pytest.mark.parametrize(
    ("size", "uniform"), [(0, [0.5]), (5, [0.5]), (4, [1.0]), (4, [-0.1]), (4, [0.5, 0.5])]
)
def test_compiled_code_reads_nothing_outside_of_the_arrays(size, uniform):
    store, batch = (Samples.zeros(lead, SampleSpec(F, A)) for lead in ((4,), (1, 1)))
    with pytest.raises(ValueError):
        batch.compiled.draw(store.compiled, size, np.array(uniform))


def test_compiled_code_learns_from_no_action_out_of_range():
    batch = Samples.zeros((1, 8), SampleSpec(F, A))
    learning = _core.QLearning((F, A), False, 1, 8, 0.1, np.inf, None)
    for wrong in (A, -1):
        batch.action[0, 3] = wrong
        with pytest.raises(ValueError, match="out of range"):
            learning.update(batch.compiled, -1.0, 1.0, 0.0)
    other = Samples.zeros((1, 7), SampleSpec(F, A))
    with pytest.raises(ValueError, match="other shapes"):
        learning.update(other.compiled, -1.0, 1.0, 0.0)
    assert learning.steps == 0
