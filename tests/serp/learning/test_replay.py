from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.errors import RunError
from serp.learning.replay import ReplayBuffer

F, A = 2, 3
DISCOUNT = 0.9


@dataclass(frozen=True)
class Step:
    """One env step; its observation is its number in the stream, so that it can be told apart."""

    number: int
    action: int
    reward: float
    terminated: bool
    truncated: bool
    allowed: tuple[bool, ...] | None
    failing: bool

    @property
    def failure(self) -> bool:
        return self.failing or (self.terminated and self.reward < 0)


def observation(number: int, after: bool = False) -> np.ndarray:
    return np.array([number, after], np.float32)


def feed(buffer: ReplayBuffer, steps: list[Step]) -> None:
    for step in steps:
        buffer.add(
            observation(step.number),
            step.action,
            step.reward,
            observation(step.number, after=True),
            step.terminated,
            step.truncated,
            None if step.allowed is None else np.array(step.allowed),
            step.failing,
        )


@st.composite
def streams(draw: st.DrawFn) -> list[Step]:
    kinds = st.tuples(
        st.integers(0, A - 1),
        st.floats(-2, 2, width=16),
        st.sampled_from(["goes on"] * 6 + ["terminated", "truncated", "both"]),
        st.none() | st.tuples(*[st.booleans()] * A),
        st.sampled_from([False] * 6 + [True]),
    )
    return [
        Step(i, a, r, end in ("terminated", "both"), end in ("truncated", "both"), mask, failing)
        for i, (a, r, end, mask, failing) in enumerate(draw(st.lists(kinds, max_size=60)))
    ]


def buffer(seed: int = 0, **settings: Any) -> ReplayBuffer:
    given = {"capacity": 50, "batch_size": 8, "discount": DISCOUNT} | settings
    return ReplayBuffer(F, A, rng=np.random.default_rng(seed), **given)


def episodes(steps: list[Step]) -> list[list[Step]]:
    found: list[list[Step]] = [[]]
    for step in steps:
        found[-1].append(step)
        if step.terminated or step.truncated:
            found.append([])
    return found


def expected_samples(steps: list[Step], n: int) -> list[tuple[Any, ...]]:
    """The definition of n-step samples, one episode at a time."""
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
                    step.number,
                    step.action,
                    reward,
                    last.number,
                    0.0 if last.terminated else DISCOUNT ** len(window),
                    forbidden if not all(forbidden) else [False] * A,
                )
            )
    return samples


def stored(buffer: ReplayBuffer, memory: str) -> list[tuple[Any, ...]]:
    """The samples of one memory, from the oldest on."""
    arrays, meta = buffer.state_dict()
    head = {"ring": meta["head"], "failing": meta["failing_head"], "early": 0}[memory]
    names = ("observation", "action", "reward", "next_observation", "discount", "forbidden")
    columns = [arrays[f"{memory}.{name}"] for name in names]
    size = len(columns[0])
    capacity = {"ring": "buffer_size"}.get(memory, f"protected_{memory}")
    start = head if size == meta["shapes"][capacity] else 0
    rows = [(start + i) % size for i in range(size)]
    assert all(columns[0][rows, 1] == 0) and all(columns[3][rows, 1] == 1)
    return [
        (
            int(columns[0][i, 0]),
            int(columns[1][i]),
            float(columns[2][i]),
            int(columns[3][i, 0]),
            float(columns[4][i]),
            columns[5][i].tolist(),
        )
        for i in rows
    ]


def assert_same_samples(found: list[tuple[Any, ...]], expected: list[tuple[Any, ...]]) -> None:
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        number, action, reward, next_number, discount, forbidden = other
        assert one == (
            number,
            action,
            pytest.approx(reward, abs=1e-5),
            next_number,
            pytest.approx(discount, abs=1e-6),
            forbidden,
        )


@settings(deadline=None)
@given(steps=streams(), n=st.integers(1, 5), capacity=st.integers(1, 30))
def test_ring_holds_the_newest_n_step_samples(steps: list[Step], n: int, capacity: int) -> None:
    ring = buffer(n_step=n, capacity=capacity)
    feed(ring, steps)
    expected = expected_samples(steps, n)
    assert_same_samples(stored(ring, "ring"), expected[-capacity:])
    assert ring.size == min(len(expected), capacity)


@settings(deadline=None)
@given(
    steps=streams(),
    n=st.integers(1, 5),
    capacity=st.integers(1, 30),
    count=st.integers(0, 40),
)
def test_the_newest_are_the_last_of_the_ring_in_order_of_time(
    steps: list[Step], n: int, capacity: int, count: int
) -> None:
    ring = buffer(n_step=n, capacity=capacity, protected_share=0.5, protected_early=5)
    feed(ring, steps)
    newest = ring.newest(count)
    found = [
        (int(x[0]), int(a), float(r), int(following[0]), float(d), forbidden.tolist())
        for x, a, r, following, d, forbidden in zip(*newest.arrays().values(), strict=True)
    ]
    expected = expected_samples(steps, n)
    assert_same_samples(found, expected[max(0, len(expected) - min(count, capacity)) :])


@pytest.mark.parametrize("steps", [0, 3, 7, 8, 12, 16, 21])
def test_the_newest_are_the_same_before_and_after_the_ring_has_wrapped(steps: int) -> None:
    ring = buffer(capacity=8)
    feed(ring, [Step(i, 0, 0.0, False, False, None, False) for i in range(steps)])
    newest = ring.newest(5).observation[:, 0].tolist()
    assert newest == list(range(max(0, steps - 5), steps))
    restored = buffer(1, capacity=8)
    restored.load_state_dict(*ring.state_dict())
    assert restored.newest(5).observation[:, 0].tolist() == newest


def test_the_newest_are_copies() -> None:
    ring = buffer(capacity=4)
    feed(ring, [Step(i, 0, 0.0, False, False, None, False) for i in range(4)])
    newest = ring.newest(4)
    feed(ring, [Step(i, 0, 0.0, False, False, None, False) for i in range(4, 8)])
    assert newest.observation[:, 0].tolist() == [0, 1, 2, 3]
    newest.observation[:] = -1.0
    assert ring.newest(4).observation[:, 0].tolist() == [4, 5, 6, 7]


@settings(deadline=None)
@given(
    steps=streams(),
    n=st.integers(1, 5),
    window=st.integers(1, 6),
    capacity=st.integers(6, 12),
    early=st.integers(0, 8),
    failing=st.integers(0, 200),
)
def test_protected_samples_survive_the_ring(
    steps: list[Step], n: int, window: int, capacity: int, early: int, failing: int
) -> None:
    memory = buffer(
        n_step=n,
        capacity=capacity,
        protected_share=0.5,
        protected_early=early,
        protected_failing=failing,
        failing_window=window,
    )
    feed(memory, steps)
    samples = expected_samples(steps, n)
    assert_same_samples(stored(memory, "early"), samples[:early])

    led_to_failure = {
        step.number
        for episode in episodes(steps)
        for end, last in enumerate(episode)
        if last.failure
        for step in episode[max(0, end + 1 - window) : end + 1]
    }
    kept = stored(memory, "failing")
    expected = [sample for sample in samples if sample[0] in led_to_failure]
    assert len(kept) == min(len(expected), failing)
    if len(expected) <= failing:
        assert_same_samples(sorted(kept), sorted(expected))


def test_failing_samples_are_overwritten_by_newer_failing_ones_only() -> None:
    memory = buffer(capacity=4, protected_share=0.5, protected_failing=3)
    ends = {1, 5, 9, 13}
    feed(memory, [Step(i, 0, -1.0, i in ends, False, None, False) for i in range(40)])
    assert [sample[0] for sample in stored(memory, "failing")] == [5, 9, 13]


def test_without_a_share_nothing_is_protected() -> None:
    memory = buffer(protected_share=0.0, protected_early=5, protected_failing=5)
    feed(memory, [Step(i, 0, -1.0, True, False, None, True) for i in range(9)])
    assert memory.protected_sizes == (0, 0)


@pytest.mark.parametrize(
    ("early", "failures", "shares"),
    [(10, 1, (3, 2)), (10, 0, (0, 5)), (0, 1, (5, 0)), (0, 0, (0, 0))],
)
def test_protected_share_of_every_batch(early: int, failures: int, shares: tuple[int, int]) -> None:
    memory = buffer(
        batch_size=20,
        capacity=10,
        protected_share=0.25,
        protected_early=early,
        protected_failing=10,
        failing_window=4,
    )
    first, failed, newest = range(10), range(10, 10 + 4 * failures), range(100, 110)
    steps = [Step(i, 0, 0.0, False, False, None, False) for i in first]
    steps += [Step(i, 0, -1.0, i == failed[-1], False, None, False) for i in failed]
    steps += [Step(i, 0, 0.0, False, False, None, False) for i in newest]
    feed(memory, steps)
    for _ in range(50):
        drawn = memory.sample().observation[0, :, 0]
        of_early, of_failing = np.isin(drawn, first).sum(), np.isin(drawn, failed).sum()
        assert (of_failing, of_early) == shares
        assert np.isin(drawn, newest).sum() == 20 - sum(shares)


def test_a_small_share_draws_at_least_one() -> None:
    memory = buffer(batch_size=8, capacity=4, protected_share=0.01, protected_early=2)
    feed(memory, [Step(i, 0, 0.0, False, False, None, False) for i in range(10)])
    for _ in range(20):
        assert (memory.sample().observation[0, :, 0] < 2).sum() == 1


def test_draws_are_uniform_whole_samples_and_differ_between_members() -> None:
    memory = buffer(batch_size=32, members=3, capacity=10, n_step=2)
    feed(memory, [Step(i, i % A, i / 2, i % 6 == 5, False, None, False) for i in range(17)])
    by_number = {sample[0]: sample for sample in stored(memory, "ring")}
    counts = dict.fromkeys(by_number, 0)
    for _ in range(200):
        batch = memory.sample()
        assert batch.observation.shape == (3, 32, F)
        assert not np.array_equal(batch.observation[0], batch.observation[1])
        for m in range(3):
            for i in range(32):
                number = int(batch.observation[m, i, 0])
                counts[number] += 1
                assert by_number[number] == (
                    number,
                    batch.action[m, i],
                    batch.reward[m, i],
                    batch.next_observation[m, i, 0],
                    batch.discount[m, i],
                    batch.forbidden[m, i].tolist(),
                )
    expected = 200 * 96 / len(counts)
    assert all(abs(count - expected) < 5 * expected**0.5 for count in counts.values())


def test_sampling_allocates_nothing() -> None:
    memory = buffer()
    feed(memory, [Step(i, 0, 0.0, False, False, None, False) for i in range(9)])
    first = memory.sample()
    assert memory.sample() is first


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="no sample"):
        buffer().sample()
    with pytest.raises(ValueError, match=r"must have shape \(2,\)"):
        buffer().add(np.zeros(1), 0, 0.0, np.zeros(F), False, False)
    for action in (-1, A):
        with pytest.raises(ValueError, match=f"3 actions, none is {action}"):
            buffer().add(np.zeros(F), action, 0.0, np.zeros(F), False, False)
    with pytest.raises(ValueError, match="failing_window"):
        buffer(capacity=3, failing_window=4)


def random_steps(rng: np.random.Generator, start: int, count: int) -> list[Step]:
    return [
        Step(
            start + i,
            int(rng.integers(A)),
            float(rng.standard_normal()),
            bool(rng.random() < 0.1),
            bool(rng.random() < 0.1),
            tuple(bool(b) for b in rng.random(A) < 0.6),
            bool(rng.random() < 0.1),
        )
        for i in range(count)
    ]


@settings(deadline=None, max_examples=60)
@given(
    before=st.integers(0, 80),
    after=st.integers(0, 40),
    n=st.integers(1, 5),
    capacity=st.integers(5, 40),
    seed=st.integers(0, 1000),
)
def test_resume_equals_uninterrupted(
    before: int, after: int, n: int, capacity: int, seed: int
) -> None:
    shape = {
        "n_step": n,
        "capacity": capacity,
        "protected_share": 0.5,
        "protected_early": 7,
        "protected_failing": 9,
        "failing_window": 4,
    }
    rng = np.random.default_rng(seed)
    one = buffer(seed, **shape)
    for step in random_steps(rng, 0, before):
        feed(one, [step])
        if one.size:
            one.sample()
    other = buffer(seed + 1, **shape)
    feed(other, random_steps(rng, 1000, seed % 30))  # what was there before is gone
    arrays, meta = one.state_dict()
    other.load_state_dict(arrays, json.loads(json.dumps(meta)))

    for step in random_steps(rng, before, after):
        for memory in (one, other):
            feed(memory, [step])
        if one.size:
            for x, y in zip(
                one.sample().arrays().values(), other.sample().arrays().values(), strict=True
            ):
                np.testing.assert_array_equal(x, y)
    arrays, meta = one.state_dict()
    other_arrays, other_meta = other.state_dict()
    assert meta == other_meta
    assert arrays.keys() == other_arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(array, other_arrays[name], strict=True)


def test_only_rows_in_use_are_saved() -> None:
    memory = buffer(capacity=1000, protected_share=0.5, protected_early=100)
    feed(memory, random_steps(np.random.default_rng(0), 0, 5))
    arrays, _ = memory.state_dict()
    assert len(arrays["ring.reward"]) == len(arrays["early.reward"]) == 5


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("buffer_size", {"capacity": 51}),
        ("n_step", {"n_step": 2}),
        ("protected_early", {"protected_share": 0.5, "protected_early": 3}),
        ("failing_window", {"failing_window": 2}),
    ],
)
def test_a_state_of_other_settings_is_refused(name: str, change: dict[str, Any]) -> None:
    memory = buffer(**change)
    with pytest.raises(RunError, match=name):
        memory.load_state_dict(*buffer().state_dict())


def test_an_incomplete_state_is_refused_and_changes_nothing() -> None:
    memory, other = buffer(), buffer(1)
    feed(memory, random_steps(np.random.default_rng(0), 0, 20))
    arrays, meta = memory.state_dict()
    arrays["ring.action"] = arrays["ring.action"][:-1]
    with pytest.raises(RunError, match=r"ring\.action has shape"):
        other.load_state_dict(arrays, meta)
    arrays, meta = memory.state_dict()
    arrays["ring.action"][3] = A
    with pytest.raises(RunError, match=r"ring\.action has entries"):
        other.load_state_dict(arrays, meta)
    assert other.size == 0
