"""The lookahead is relied on as long as it does not fail."""

from __future__ import annotations

from itertools import zip_longest

from hypothesis import given
from hypothesis import strategies as st

from serp.agent.veto import LookaheadReliability

STEPS = st.lists(st.tuples(st.booleans(), st.booleans(), st.booleans()), max_size=200)
"""(predicted safe, unsafe, last) of env steps."""


def failures(steps: list[tuple[bool, bool, bool]], horizon: int) -> int:
    """What `LookaheadReliability` counts, looked up step by step in the list."""
    count, begin = 0, 0
    for now, (_, unsafe, last) in enumerate(steps):
        predicted = [k for k in range(max(begin, now - horizon + 1), now + 1) if steps[k][0]]
        if unsafe and predicted:
            count += 1
            begin = now + 1
        if last:
            begin = now + 1
    return count


@given(steps=STEPS, others=STEPS, horizon=st.integers(1, 12))
def test_it_fails_by_what_is_unsafe_within_the_horizon_of_a_prediction_and_the_episode(
    steps: list[tuple[bool, bool, bool]], others: list[tuple[bool, bool, bool]], horizon: int
) -> None:
    """The steps of two environments alternate; that of one cuts its episodes off afterwards."""
    lookahead = LookaheadReliability(horizon)
    failed = 0
    for first, second in zip_longest(steps, others):
        if first is not None:
            failed += lookahead.observe(*first)
        if second is not None:
            *seen, last = second
            failed += lookahead.observe(*seen, last=False, env_index=1)
            if last:
                lookahead.cut_off(1)
    assert lookahead.failures == failed == failures(steps, horizon) + failures(others, horizon)


def test_it_is_relied_on_up_to_three_failures_and_one_in_a_thousand_steps() -> None:
    lookahead, rare = LookaheadReliability(10), LookaheadReliability(10)
    for failed in range(1, 6):
        lookahead.observe(predicted_safe=True, unsafe=True, last=True)
        resumed = LookaheadReliability(10)
        resumed.load_state_dict(lookahead.state_dict())
        assert resumed.failures == lookahead.failures == failed
        assert resumed.reliable == lookahead.reliable == (failed <= 3)
    for step in range(5_000):
        rare.observe(predicted_safe=True, unsafe=step % 1_000 == 999, last=False)
        assert rare.reliable
