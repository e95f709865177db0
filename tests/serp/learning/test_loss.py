"""The loss, with and without imitation, by its definition: one sample at a time, by autograd."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from serp import _core
from serp.learning.dqn import ReturnBounds
from serp.learning.replay import Samples
from tests.serp.learning.learners import learner, set_q

E, B, A = 2, 7, 4
LOWER, UPPER = -1.5, 2.5


def draw(seed, imitates):
    """Return Q-values and a batch; Q in steps of 1/4, so that there are ties, nothing near one."""
    rng = np.random.default_rng(seed)

    def values(*shape):
        return (rng.integers(-12, 13, shape) / 4).astype(np.float32)

    q = {name: values(E, B, A) for name in ("q", "next_q", "choice_q")}
    forbidden = rng.random((E, B, A)) < 0.4
    forbidden[..., 0] &= ~forbidden.all(-1)
    batch = Samples(
        observation=values(E, B, 1),
        action=rng.integers(0, A, (E, B)),
        reward=values(E, B),
        next_observation=values(E, B, 1),
        discount=rng.choice(np.array([0.0, 0.5, 0.9], np.float32), (E, B)),
        forbidden=forbidden,
        imitated=rng.integers(-1, A, (E, B)) if imitates else np.zeros(0, np.int64),
    )
    return q, batch


Imitation = tuple[float, float] | None
"""Margin and weight."""


def compiled(q, batch, how):
    margin, weight = how or (0.0, 0.0)
    return _core.td_gradient(
        q["q"], q["next_q"], q["choice_q"], batch.compiled, LOWER, UPPER, margin, weight
    )


def by_definition(values, batch, how):
    q = torch.tensor(values["q"], dtype=torch.float64, requires_grad=True)
    total = torch.zeros((), dtype=torch.float64)
    for e in range(E):
        losses = []
        for i in range(B):
            allowed = np.flatnonzero(~batch.forbidden[e, i])
            best = allowed[values["choice_q"][e, i][allowed].argmax()]
            value = np.clip(values["next_q"][e, i, best], LOWER, UPPER)
            target = float(batch.reward[e, i]) + float(batch.discount[e, i]) * float(value)
            own = q[e, i, batch.action[e, i]]
            losses.append(
                torch.nn.functional.mse_loss(own, torch.tensor(target, dtype=torch.float64))
            )
            said = -1 if how is None else batch.imitated[e, i]
            if how is not None and said >= 0:
                margins = torch.full((A,), how[0], dtype=torch.float64)
                margins[said] = 0.0
                above = q[e, i] + margins
                highest = np.flatnonzero(above.detach() == above.detach().max())
                rival = said if said in highest else highest[0]
                losses.append(how[1] * (above[rival] - q[e, i, said]))
        total = total + torch.stack(losses).sum() / B
    total.backward()
    assert q.grad is not None
    return total.item() / E, q.grad.numpy()


HOW = st.none() | st.tuples(st.sampled_from([0.0, 0.25, 0.8]), st.sampled_from([0.0, 0.5, 2.0]))


@settings(deadline=None, max_examples=80)
@given(how=HOW, seed=st.integers(0, 10_000))
def test_loss_and_gradient_are_those_of_the_definition(how, seed):
    q, batch = draw(seed, how is not None)
    loss, gradient = compiled(q, batch, how)
    expected, of_autograd = by_definition(q, batch, how)
    assert loss == pytest.approx(expected, rel=1e-5, abs=1e-6)
    np.testing.assert_allclose(gradient, of_autograd, rtol=1e-5, atol=1e-6)


# Which network says what: Q is the same in every state, online [0, 2, 8], target [0, 4, 1].
ONLINE, TARGET = [0.0, 2.0, 8.0], [0.0, 4.0, 1.0]
FREE: dict[str, Any] = {"n_step": 1, "discount": 0.5}
ALL = np.ones(3, np.bool_)
SPREAD = float(np.std(ONLINE))
LOW = ~np.eye(3, dtype=bool)[2]


@pytest.mark.parametrize(
    ("changes", "imitated", "allowed", "ended", "expected"),
    [
        ({"target_polyak": None}, None, ALL, "", (1 + 0.5 * 8) ** 2),
        ({}, None, ALL, "", (1 + 0.5 * 1) ** 2),
        # What is forbidden never counts; where everything is, everything does.
        ({}, None, LOW, "", (1 + 0.5 * 4) ** 2),
        ({}, None, ~ALL, "", (1 + 0.5 * 1) ** 2),
        ({"target_polyak": None}, None, LOW, "", (1 + 0.5 * 8) ** 2),
        # An end has no value, a time limit does.
        ({"n_step": 3}, None, ALL, "terminated", 1.0),
        ({"n_step": 3}, None, ALL, "truncated", (1 + 0.5 * 1) ** 2),
        # Margin and weight in units of the standard deviation of Q.
        ({}, 1, ALL, "terminated", 1 + 0.5 * SPREAD * (8 + SPREAD - 2)),
        ({}, 2, ALL, "terminated", 1.0),
        ({}, -1, ALL, "terminated", 1.0),
    ],
)  # fmt: skip
def test_each_value_is_asked_of_the_right_network(
    changes, imitated, allowed, ended, expected
):  # fmt: skip
    agent = learner(imitates=imitated is not None, **{**FREE, **changes})
    agent.imitation_weight = 0.5
    set_q(agent, ONLINE, TARGET)
    x = np.zeros(4, np.float32)
    agent.remember(
        x,
        0,
        1.0,
        x,
        ended == "terminated",
        ended == "truncated",
        allowed,
        -1 if imitated is None else imitated,
    )
    agent._bounds = ReturnBounds(0.5)  # nothing is clipped
    assert agent.pretrain(1) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(("polyak", "expected"), [(0.05, (1 + 0.5 * 2) ** 2), (None, 25.0)])
def test_with_a_target_network_a_next_value_is_no_larger_than_any_return(polyak, expected):
    agent, x = learner(**FREE, target_polyak=polyak), np.zeros(4, np.float32)
    set_q(agent, ONLINE, [0.0, 4.0, 100.0])
    agent.remember(x, 0, 1.0, x, False, False, ALL)  # for ever rewards of 1, halved: 2
    assert agent.pretrain(1) == pytest.approx(expected, rel=1e-5)
