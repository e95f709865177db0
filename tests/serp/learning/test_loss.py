"""The loss, with and without a guide, by its definition: one sample at a time, by autograd."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.learning.guidance import Guidance, GuidedLearning
from serp.learning.loss import td_gradient
from serp.learning.samples import Samples
from tests.serp.learning.learners import learner, set_q

E, B, A = 2, 7, 4
LOWER, UPPER = -1.5, 2.5


def draw(seed: int) -> tuple[dict[str, np.ndarray], Samples]:
    """Return Q-values and a batch; Q in steps of 1/4, so that there are ties, nothing near one."""
    rng = np.random.default_rng(seed)

    def values(*shape: int) -> np.ndarray:
        return (rng.integers(-12, 13, shape) / 4).astype(np.float32)

    q = {name: values(E, B, A) for name in ("q", "next_q", "choice_q", "filter_q")}
    forbidden = rng.random((E, B, A)) < 0.4
    forbidden[..., 0] &= ~forbidden.all(-1)
    batch = Samples(
        observation=values(E, B, 1),
        action=rng.integers(0, A, (E, B)),
        reward=values(E, B),
        next_observation=values(E, B, 1),
        discount=rng.choice(np.array([0.0, 0.5, 0.9], np.float32), (E, B)),
        forbidden=forbidden,
        guide_action=rng.integers(-1, A, (E, B)),
        guide_value=values(E, B),
        guide_next_action=rng.integers(-1, A, (E, B)),
        guide_next_values=values(E, B, A),
    )
    return q, batch


def compiled(
    q: dict[str, np.ndarray], batch: Samples, guided: GuidedLearning | None, huber: bool
) -> tuple[float, np.ndarray]:
    gradient = np.full((E, B, A), np.nan, np.float32)
    how = None if guided is None else (
        guided.bootstrap_guide, guided.residual, guided.q_filter, np.float32(guided.margin),
        np.float32(guided.margin_weight),
    )  # fmt: skip
    loss = td_gradient(
        tuple(q.values()), (batch.action, batch.reward, batch.discount, batch.forbidden),
        (np.float32(LOWER), np.float32(UPPER)), huber,
        None if guided is None else tuple(batch[6:]), how, gradient,
    )  # fmt: skip
    return loss, gradient


def by_definition(
    values: dict[str, np.ndarray], batch: Samples, how: GuidedLearning, huber: bool
) -> tuple[float, np.ndarray]:
    q = torch.tensor(values["q"], dtype=torch.float64, requires_grad=True)
    total = torch.zeros((), dtype=torch.float64)
    for e in range(E):
        losses = []
        for i in range(B):
            base = batch.guide_next_values[e, i] if how.residual else np.zeros(A)
            of_next, of_choice = values["next_q"][e, i] + base, values["choice_q"][e, i] + base
            allowed = np.flatnonzero(~batch.forbidden[e, i])
            candidates = [allowed[of_choice[allowed].argmax()]]
            then = batch.guide_next_action[e, i]
            if how.bootstrap_guide and then in allowed:
                candidates.append(then)
            value = np.clip(max(of_next[a] for a in candidates), LOWER, UPPER)
            target = float(batch.reward[e, i]) + float(batch.discount[e, i]) * float(value)
            own = q[e, i, batch.action[e, i]] + (batch.guide_value[e, i] if how.residual else 0.0)
            kind = torch.nn.functional.huber_loss if huber else torch.nn.functional.mse_loss
            losses.append(kind(own, torch.tensor(target, dtype=torch.float64)))
            said = batch.guide_action[e, i]
            judged = values["filter_q"][e, i]
            trusted = not how.q_filter or judged[said] >= judged[values["q"][e, i].argmax()]
            if said >= 0 and trusted:
                margins = torch.full((A,), how.margin, dtype=torch.float64)
                margins[said] = 0.0
                above = q[e, i] + margins
                highest = np.flatnonzero(above.detach() == above.detach().max())
                rival = said if said in highest else highest[0]
                losses.append(how.margin_weight * (above[rival] - q[e, i, said]))
        total = total + torch.stack(losses).sum() / B
    total.backward()
    assert q.grad is not None
    return total.item() / E, q.grad.numpy()


HOW = (
    st.none()
    | st.builds(
        GuidedLearning,
        margin=st.sampled_from([0.0, 0.25, 0.8]),
        margin_weight=st.sampled_from([0.0, 0.5, 2.0]),
        q_filter=st.booleans(),
        bootstrap_guide=st.booleans(),
    )
    | st.builds(GuidedLearning, residual=st.just(True), bootstrap_guide=st.booleans())
)


@settings(deadline=None, max_examples=200)
@given(how=HOW, huber=st.booleans(), seed=st.integers(0, 10_000))
def test_loss_and_gradient_are_those_of_the_definition(
    how: GuidedLearning | None, huber: bool, seed: int
) -> None:
    q, batch = draw(seed)
    loss, gradient = compiled(q, batch, how, huber)
    expected, of_autograd = by_definition(q, batch, how or GuidedLearning(), huber)
    assert loss == pytest.approx(expected, rel=1e-5, abs=1e-6)
    np.testing.assert_allclose(gradient, of_autograd, rtol=1e-5, atol=1e-6)


# Which network says what: Q is the same in every state, online [0, 2, 8], target [0, 4, 1].
ONLINE, TARGET = [0.0, 2.0, 8.0], [0.0, 4.0, 1.0]
FREE: dict[str, Any] = {
    "n_step": 1, "clip_targets": False, "discount": 0.5, "target_period": 100, "double": False,
}  # fmt: skip
ALL, NOBODY = np.ones(3, np.bool_), Guidance(-1, 0.0, -1, np.zeros(3))
IMITATION = GuidedLearning(margin_weight=0.5, margin=0.25)
SPREAD = float(np.std(ONLINE))


@pytest.mark.parametrize(
    ("changes", "guided", "guidance", "allowed", "ended", "expected"),
    [
        ({"target_period": None}, None, None, ALL, "", (1 + 0.5 * 8) ** 2),
        ({"target_period": None, "double": True}, None, None, ALL, "", (1 + 0.5 * 8) ** 2),
        ({}, None, None, ALL, "", (1 + 0.5 * 4) ** 2),
        ({"double": True}, None, None, ALL, "", (1 + 0.5 * 1) ** 2),
        # What is forbidden never counts; where everything is, everything does.
        ({"target_period": None}, None, None, ~np.eye(3, dtype=bool)[2], "", (1 + 0.5 * 2) ** 2),
        ({"double": True}, None, None, ~np.eye(3, dtype=bool)[2], "", (1 + 0.5 * 4) ** 2),
        ({}, None, None, ~ALL, "", (1 + 0.5 * 4) ** 2),
        ({"mask_targets": False}, None, None, np.eye(3, dtype=bool)[0], "", (1 + 0.5 * 4) ** 2),
        # An end has no value, a time limit does.
        ({"n_step": 3}, None, None, ALL, "terminated", 1.0),
        ({"n_step": 3}, None, None, ALL, "truncated", (1 + 0.5 * 4) ** 2),
        # The reward is always 1, γ = 0.5: an endless episode is worth 2; in units of Q.
        ({"clip_targets": True}, None, None, ALL, "", (1 + 0.5 * 2) ** 2),
        ({"clip_targets": True, "reward_scale": 3.0}, None, None, ALL, "", (3 + 0.5 * 6) ** 2),
        ({"loss": "huber"}, None, None, ALL, "", 3.0 - 0.5),
        # The guide's action is a candidate, valued by the target network.
        ({"double": True}, GuidedLearning(bootstrap_guide=True), NOBODY._replace(next_action=1),
         ALL, "", (1 + 0.5 * 4) ** 2),
        ({"double": True}, GuidedLearning(bootstrap_guide=True), NOBODY._replace(next_action=0),
         ALL, "", (1 + 0.5 * 1) ** 2),
        # Action 1 is no worse than the learner's choice, action 2, by the target network.
        ({}, IMITATION, NOBODY._replace(action=1), ALL, "terminated", 1 + 0.5 * (8.25 - 2)),
        ({}, IMITATION, NOBODY._replace(action=0), ALL, "terminated", 1.0),
        # Margin and weight in units of the standard deviation of Q.
        ({}, replace(IMITATION, relative=True), NOBODY._replace(action=1), ALL, "terminated",
         1 + 0.5 * SPREAD * (8 + 0.25 * SPREAD - 2)),
        # The guide's values are added: 3 + 0 by the network is the largest sum, worth 9 + 0.
        ({"double": True}, GuidedLearning(residual=True),
         Guidance(-1, 4.0, -1, np.array([9.0, 2.0, 0.0])), ALL, "", (4 - (1 + 0.5 * 9)) ** 2),
    ],
)  # fmt: skip
def test_each_value_is_asked_of_the_right_network(
    changes: dict[str, Any], guided: GuidedLearning | None, guidance: Guidance | None,
    allowed: np.ndarray, ended: str, expected: float,
) -> None:  # fmt: skip
    agent = learner(guided=guided, **{**FREE, **changes})
    set_q(agent, ONLINE, TARGET)
    x = np.zeros(4, np.float32)
    agent.remember(
        x, 0, 1.0, x, ended == "terminated", ended == "truncated", allowed, guidance=guidance
    )
    assert agent.pretrain(1) == pytest.approx(expected, rel=1e-5)
