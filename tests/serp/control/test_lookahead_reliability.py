"""The lookahead is believed as long as its word is kept."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from serp.control.lookahead_reliability import LookaheadReliability

STEPS = st.lists(st.tuples(st.booleans(), st.booleans(), st.booleans()), max_size=200)
"""(promised, unsafe, last) of env steps."""


def broken_promises(steps: list[tuple[bool, bool, bool]], horizon: int) -> int:
    """What `LookaheadReliability` counts, looked up step by step in the list."""
    count, begin = 0, 0
    for now, (_, unsafe, last) in enumerate(steps):
        made = [k for k in range(max(begin, now - horizon + 1), now + 1) if steps[k][0]]
        if unsafe and made:
            count += 1
            begin = now + 1
        if last:
            begin = now + 1
    return count


@given(steps=STEPS, horizon=st.integers(1, 12))
def test_a_promise_is_broken_by_what_is_unsafe_within_the_horizon_and_the_episode(
    steps: list[tuple[bool, bool, bool]], horizon: int
) -> None:
    promises = LookaheadReliability(horizon, forgiven=None)
    for promised, unsafe, last in steps:
        promises.observe(promised, unsafe, last)
    assert promises.broken == broken_promises(steps, horizon)
    assert promises.believed


def test_what_was_never_promised_is_not_broken() -> None:
    promises = LookaheadReliability(10, forgiven=0)
    for _ in range(50):
        promises.observe(promised=False, unsafe=True, last=False)
    assert promises.broken == 0
    assert promises.believed


def test_belief_ends_after_what_is_forgiven() -> None:
    promises = LookaheadReliability(10, forgiven=3)
    for broken in range(1, 6):
        promises.observe(promised=True, unsafe=True, last=True)
        assert promises.broken == broken
        assert promises.believed == (broken <= 3)


def test_one_broken_promise_in_a_thousand_steps_is_forgiven() -> None:
    promises = LookaheadReliability(10, forgiven=0)
    for step in range(5_000):
        promises.observe(promised=True, unsafe=step % 1_000 == 999, last=False)
        assert promises.believed


def test_a_restored_count_goes_on_as_the_one_that_was_saved() -> None:
    first = LookaheadReliability(5, forgiven=1)
    for _ in range(2):
        first.observe(promised=True, unsafe=True, last=True)
    second = LookaheadReliability(5, forgiven=1)
    second.load_state_dict(first.state_dict())
    assert (second.broken, second.believed) == (2, False)
    assert second.state_dict() == first.state_dict()
