"""Explanations quote the line that is to blame, with the values it reads."""

from itertools import zip_longest

import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.agent.arbiter import Arbiter
from serp.agent.veto import LookaheadReliability
from serp.model.transition_model import TransitionModel
from serp.planning.lookahead import Lookahead
from serp.settings import PlannerSettings
from serp.tasks.action_map import ActionMap
from tests.generated import Texts, load_texts

TEXT = """(define (domain lab) (:requirements :typing :fluents)
  (:constants kitchen hall)
  (:predicates (at ?room) (open) (unsafe) (terminal)) (:functions (battery) (load) (reward))
  (:action drive :parameters (?to)
    :precondition (and (open)
      (>= (battery) 0.25) (not (at ?to)))
    :effect (and (at ?to) (decrease (battery) 0.5)))
  (:action lift
    :precondition (and (or (open) (< (load) 1)) (not (unsafe)) (> 2 1))
    :effect (and (increase (load) 1)
      (when (> (load) 2) (unsafe))))
  (:action calm :effect (and (decrease (load) 4)))
  (:action both :effect (and (when (open) (assign (load) 1)) (when (open) (increase (load) 2))))
  (:action split :effect (and (assign (load) (/ 1 (battery)))))
  (:action never :precondition (and (> 1 2)) :effect (and (open)))
  (:event empty :precondition (and (< (battery) 0)) :effect (and (unsafe))))
"""


@pytest.fixture(scope="module")
def lab() -> TransitionModel:
    return load_texts(Texts(TEXT, None)).model


@pytest.mark.parametrize(
    ("action", "given", "says"),
    [
        ("drive hall", {}, "`(open)` (line 5) does not hold (open = false)"),
        (
            "drive hall",
            {"open": 1, "battery": 0.125},
            "`(>= (battery) 0.25)` (line 6) does not hold (battery = 0.125)",
        ),
        (
            "lift",
            {"load": 1.5},
            "`(or (open) (< (load) 1))` (line 9) does not hold (open = false, load = 1.5)",
        ),
        ("never", {}, "`(> 1 2)` (line 15) does not hold"),
        ("both", {"open": 1}, "`(increase (load) 2)` (line 13) contradicts another effect"),
        ("split", {}, "split gives no finite number"),
        ("lift", {"open": 1, "load": 3}, "unsafe: `(unsafe)` (line 11)"),
        (
            "drive hall",
            {"open": 1, "battery": 0.25},
            "unsafe: `(unsafe)` (line 16) through event empty",
        ),
        ("calm", {}, ""),
        ("lift", {"open": 1, "load": 2}, ""),
    ],
)
def test_the_line_that_is_to_blame_is_quoted_with_the_values_it_reads(
    lab: TransitionModel, action: str, given: dict[str, float], says: str
) -> None:
    state = lab.state({f.name: given.get(f.name, 0.0) for f in lab.fluents})
    actions = ActionMap(lab, len(lab.actions))
    arbiter = Arbiter(Lookahead(lab, PlannerSettings(depth=1)), actions)
    shown = arbiter.alternatives(arbiter.forecast(state), state)[lab.action_index(action)]
    assert shown.remark.removeprefix("not applicable: ") == says


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
