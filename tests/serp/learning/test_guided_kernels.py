from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.learning import guided_kernels, kernels
from serp.learning.guidance import GuidedLearning
from serp.learning.samples import GuideSamples, Samples

E, B, A = 2, 7, 4
LOWER, UPPER = -1.5, 2.5


def draw(seed: int) -> tuple[dict[str, np.ndarray], Samples]:
    """Q-values and a batch; Q in steps of 1/4, so that there are ties, nothing near one."""
    rng = np.random.default_rng(seed)

    def values(*shape: int) -> np.ndarray:
        return (rng.integers(-12, 13, shape) / 4).astype(np.float32)

    q = {name: values(E, B, A) for name in ("q", "next_q", "choice_q", "filter_q")}
    forbidden = rng.random((E, B, A)) < 0.4
    forbidden[..., 0] &= ~forbidden.all(-1)
    guide = GuideSamples(
        action=rng.integers(-1, A, (E, B)),
        value=values(E, B),
        next_action=rng.integers(-1, A, (E, B)),
        next_values=values(E, B, A),
    )
    batch = Samples(
        observation=values(E, B, 1),
        action=rng.integers(0, A, (E, B)),
        reward=values(E, B),
        next_observation=values(E, B, 1),
        discount=rng.choice(np.array([0.0, 0.5, 0.9], np.float32), (E, B)),
        forbidden=forbidden,
        guide=guide,
    )
    return q, batch


def compiled(
    q: dict[str, np.ndarray], batch: Samples, how: GuidedLearning, huber: bool
) -> tuple[float, np.ndarray]:
    assert batch.guide is not None
    gradient = np.full((E, B, A), np.nan, np.float32)
    loss = guided_kernels.guided_td_gradient(
        q["q"], q["next_q"], q["choice_q"], q["filter_q"],
        batch.action, batch.reward, batch.discount, batch.forbidden,
        *batch.guide.arrays().values(),
        np.float32(LOWER), np.float32(UPPER), huber, how.bootstrap_guide, how.residual,
        np.float32(how.margin), np.float32(how.margin_weight), how.q_filter, gradient,
    )  # fmt: skip
    return loss, gradient


def by_definition(
    values: dict[str, np.ndarray], batch: Samples, how: GuidedLearning, huber: bool
) -> tuple[float, np.ndarray]:
    """One sample at a time, its gradient by autograd."""
    guide = batch.guide
    assert guide is not None
    q = torch.tensor(values["q"], dtype=torch.float64, requires_grad=True)
    total = torch.zeros((), dtype=torch.float64)
    for e in range(E):
        losses = []
        for i in range(B):
            base = guide.next_values[e, i] if how.residual else np.zeros(A)
            of_next, of_choice = values["next_q"][e, i] + base, values["choice_q"][e, i] + base
            allowed = np.flatnonzero(~batch.forbidden[e, i])
            candidates = [allowed[of_choice[allowed].argmax()]]
            then = guide.next_action[e, i]
            if how.bootstrap_guide and then in allowed:
                candidates.append(then)
            value = np.clip(max(of_next[a] for a in candidates), LOWER, UPPER)
            target = float(batch.reward[e, i]) + float(batch.discount[e, i]) * float(value)
            own = q[e, i, batch.action[e, i]] + (guide.value[e, i] if how.residual else 0.0)
            kind = torch.nn.functional.huber_loss if huber else torch.nn.functional.mse_loss
            losses.append(kind(own, torch.tensor(target, dtype=torch.float64)))
            said = guide.action[e, i]
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


HOW = st.builds(
    GuidedLearning,
    margin=st.sampled_from([0.0, 0.25, 0.8]),
    margin_weight=st.sampled_from([0.0, 0.5, 2.0]),
    q_filter=st.booleans(),
    bootstrap_guide=st.booleans(),
) | st.builds(GuidedLearning, residual=st.just(True), bootstrap_guide=st.booleans())


@settings(deadline=None, max_examples=150)
@given(how=HOW, huber=st.booleans(), seed=st.integers(0, 10_000))
def test_loss_and_gradient_are_those_of_the_definition(
    how: GuidedLearning, huber: bool, seed: int
) -> None:
    q, batch = draw(seed)
    loss, gradient = compiled(q, batch, how, huber)
    expected, of_autograd = by_definition(q, batch, how, huber)
    assert loss == pytest.approx(expected, rel=1e-5, abs=1e-6)
    np.testing.assert_allclose(gradient, of_autograd, rtol=1e-5, atol=1e-6)


@settings(deadline=None, max_examples=100)
@given(
    how=st.builds(GuidedLearning, q_filter=st.booleans()),
    huber=st.booleans(),
    seed=st.integers(0, 10_000),
)
def test_with_everything_off_the_bits_are_those_without_a_guide(
    how: GuidedLearning, huber: bool, seed: int
) -> None:
    q, batch = draw(seed)
    for array in q.values():
        array += np.random.default_rng(seed).standard_normal(array.shape).astype(np.float32)
    gradient = np.full((E, B, A), np.nan, np.float32)
    loss = kernels.td_gradient(
        q["q"], q["next_q"], q["choice_q"],
        batch.action, batch.reward, batch.discount, batch.forbidden,
        np.float32(LOWER), np.float32(UPPER), huber, gradient,
    )  # fmt: skip
    guided_loss, guided_gradient = compiled(q, batch, how, huber)
    assert guided_loss == loss
    np.testing.assert_array_equal(guided_gradient, gradient)


def test_a_guide_that_is_clearly_the_best_or_silent_leaves_no_imitation() -> None:
    q, batch = draw(0)
    assert batch.guide is not None
    for said, lead in ((2, np.float32(5.0)), (-1, np.float32(0.0))):
        batch.guide.action[:] = said
        values: dict[str, Any] = {**q, "q": q["q"].copy()}
        values["q"][..., 2] += values["q"].max() + lead
        plain = compiled(values, batch, GuidedLearning(), huber=False)
        imitating = compiled(
            values, batch, GuidedLearning(margin_weight=3.0, q_filter=False), huber=False
        )
        assert imitating[0] == plain[0]
        np.testing.assert_array_equal(imitating[1], plain[1])
