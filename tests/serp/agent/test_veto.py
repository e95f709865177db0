"""Explanations quote the line that is to blame, with the values it reads."""

from itertools import zip_longest
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.agent.arbiter import Arbiter
from serp.agent.decision import Reason
from serp.agent.veto import LookaheadReliability, VetoPolicy
from serp.learning.dqn import Proposal
from serp.model.flags import APPLICABLE, RISK_SHIFT, RISKY
from serp.planning.lookahead import Lookahead
from serp.settings import ArbiterSettings, PlannerSettings
from serp.tasks.action_map import ActionMap
from tests.generated import Texts, load_texts
from tests.worlds import text
from tests.worlds.merging import merging_task

TEXT = text("lab")


@pytest.fixture(scope="module")
def lab():
    return load_texts(Texts(TEXT, None)).model


@pytest.mark.parametrize(
    ("action", "given", "says"),
    [
        ("drive hall", {}, "`(open)` (line 5) does not hold (open = false)"),
        ("lift", {"load": 1.5}, "(line 9) does not hold (open = false, load = 1.5)"),
        ("both", {"open": 1}, "`(increase (load) 2)` (line 13) contradicts another effect"),
        ("split", {}, "split does not give a finite number"),
        ("lift", {"open": 1, "load": 3}, "unsafe: `(unsafe)` (line 11)"),
        ("drive hall", {"open": 1, "battery": 0.25}, "(line 16) through event empty"),
        ("lift", {"open": 1, "load": 2}, ""),
    ],
)
def test_the_line_that_is_to_blame_is_quoted_with_the_values_it_reads(lab, action, given, says):
    state = lab.state({f.name: given.get(f.name, 0.0) for f in lab.fluents})
    actions = ActionMap(lab, len(lab.actions))
    arbiter = Arbiter(Lookahead(lab, PlannerSettings(depth=1)), actions)
    shown = arbiter.alternatives(arbiter.forecast(state), state)[lab.action_index(action)]
    assert shown.remark.endswith(says) and bool(shown.remark) == bool(says)


STEPS = st.lists(st.tuples(st.booleans(), st.booleans(), st.booleans()), max_size=200)
"""(predicted safe, unsafe, last) of env steps."""


def failures(steps, horizon):
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
    steps, others, horizon
):
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


def test_it_is_relied_on_up_to_three_failures_and_one_in_a_thousand_steps():
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


def test_the_risk_to_accept_is_what_one_whole_episode_would_have_needed(lab):
    actions = ActionMap(lab, len(lab.actions))
    vetoes = VetoPolicy(actions, ArbiterSettings())
    count = len(lab.actions)

    def seen(risk, last):
        found = SimpleNamespace(
            choice=0, flags=np.full(count, RISKY | APPLICABLE), path_risk=np.full(count, risk),
            value=np.arange(count), safe_steps=np.zeros(count),
        )  # fmt: skip
        found.path_risk[0] = 0.0
        decision = SimpleNamespace(unsafe=True, risk=0.0, forecast=found, action=0)
        vetoes.observe(SimpleNamespace(decision=decision, unsafe=False, last=last))

    for episode in ((0.01, 0.3), (0.2, 0.02, 0.1), (0.0, 0.0), (0.5,)):
        for step, risk in enumerate(episode, 1):
            seen(risk, step == len(episode))
    assert vetoes.needed_risk == 0.2


def test_after_a_failure_actions_have_to_leave_safe_ways_on_beyond_the_lookahead():
    """A car that cannot stop before its ramp ends, and has to merge between two others."""
    task = merging_task().bind()
    actions = ActionMap(task.model, 4)
    arbiter = Arbiter(Lookahead(task.model, PlannerSettings()), actions)
    state, faster = np.array([0.0, 60.0, 20.0, 30.0, 14.0, 5.0, 20.0]), Proposal(2, False)
    assert arbiter.judge_proposal(state, faster).reason is Reason.ACCEPTED
    arbiter.vetoes.reliability.observe(True, unsafe=True, last=True)
    decision = arbiter.judge_proposal(state, faster)
    assert decision.reason is Reason.FEW_WAYS_ON and decision.action == 0
    assert "beyond the lookahead" in arbiter.explain(decision, state)
    saved = arbiter.state_dict()
    other = Arbiter(Lookahead(task.model, PlannerSettings()), actions)
    other.load_state_dict(saved)
    assert other.judge_proposal(state, faster).reason is Reason.FEW_WAYS_ON


def test_the_account_compares_risks_with_what_came_and_names_the_least_that_would_pass():
    task = merging_task().bind()
    arbiter = Arbiter(Lookahead(task.model, PlannerSettings()), ActionMap(task.model, 4))
    state = np.array([0.0, 60.0, 20.0, 30.0, 14.0, 5.0, 20.0])
    decision, quarter = arbiter.plan(state), 1 << RISK_SHIFT + 22
    known = decision.forecast
    other = known.choice - 1
    flags, value, risk = known.flags.copy(), known.value.copy(), known.path_risk.copy()
    flags[other], risk[other] = APPLICABLE | RISKY | quarter, 0.25
    value[other] = value[known.choice] + 1.0
    flags[known.choice] |= quarter
    decision = decision._replace(forecast=known._replace(flags=flags, value=value, path_risk=risk))
    vetoes = arbiter.vetoes
    for unsafe in (True, False, False, False):
        vetoes.observe(SimpleNamespace(decision=decision, unsafe=unsafe, last=True))
    account = vetoes.account_of_risk()
    assert "the learned risks predicted 1.0 unsafe steps; 1 were observed." in account
    assert "In 4 steps" in account and "accepted_risk of 25 % or more" in account
    saved = VetoPolicy(arbiter.actions, arbiter.settings)
    saved.load_state_dict(vetoes.state_dict())
    assert saved.account_of_risk() == account
