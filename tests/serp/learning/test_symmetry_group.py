from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.learning import DQN
from serp.learning.replay import ReplayBuffer
from serp.learning.symmetry_group import MOST_AVERAGED, MOST_ELEMENTS, Element, SymmetryGroup
from serp.settings import LearnerSettings
from tests.serp.learning.test_dqn import assert_same_state

F, A = 5, 4


@st.composite
def elements(draw: st.DrawFn) -> Element:
    return Element(
        tuple(draw(st.permutations(range(F)))),
        tuple(draw(st.lists(st.sampled_from((1.0, -1.0)), min_size=F, max_size=F))),
        tuple(draw(st.permutations(range(A)))),
    )


def cycle(length: int) -> Element:
    """Turns the first inputs, and three actions with them where that is a whole number of turns."""
    turned = tuple((i + 1) % length if i < length else i for i in range(F))
    return Element(turned, (1.0,) * F, (1, 2, 0, 3) if length == 3 else (0, 1, 2, 3))


MIRROR = Element((1, 0, 2, 3, 4), (1.0, 1.0, -1.0, 1.0, 1.0), (0, 2, 1, 3))
GROUPS = {
    "mirror": ([MIRROR], 2, 2),
    "turns": ([cycle(3)], 3, 3),
    "turns and mirror": ([cycle(4), Element((3, 2, 1, 0, 4), (1.0,) * F, (0, 1, 2, 3))], 8, 8),
    "large": ([cycle(4), Element((1, 0, 2, 3, 4), (1.0,) * F, (1, 0, 2, 3))], 48, 4),
}


def learner(group: SymmetryGroup | None, **changes: Any) -> DQN:
    small: dict[str, Any] = {
        "hidden": (8,), "batch_size": 8, "buffer_size": 64, "learning_starts": 1, "members": 2,
        "symmetry": True, "epsilon_end": 0.5, "epsilon_steps": 10,
    }  # fmt: skip
    return DQN(F, A, LearnerSettings(**{**small, **changes}), 3, group)


def live(agent: DQN, rng: np.random.Generator, steps: int) -> list[Any]:
    said: list[Any] = []
    for _ in range(steps):
        x, next_x = rng.standard_normal((2, F)).astype(np.float32)
        action = agent.propose(x).action
        end = bool(rng.random() < 0.1)
        allowed = rng.random(A) < 0.7
        agent.remember(x, action, float(rng.standard_normal()), next_x, end, False, allowed, end)
        said.append((action, agent.learn(), agent.q_values(next_x).tolist()))
    return said


# --- groups --------------------------------------------------------------------------------------


@given(elements(), elements(), st.integers(0, 2**32 - 1))
def test_a_product_does_the_second_after_the_first(one: Element, other: Element, seed: int) -> None:
    x = np.random.default_rng(seed).standard_normal(F)
    q = np.random.default_rng(seed).standard_normal(A)
    both = other.after(one)
    np.testing.assert_array_equal(both.of_input(x), other.of_input(one.of_input(x)))
    np.testing.assert_array_equal(both.of_actions(q), other.of_actions(one.of_actions(q)))


@given(st.lists(elements(), max_size=3))
@settings(max_examples=50, deadline=None)
def test_a_group_is_one_and_so_is_what_q_is_averaged_over(generators: list[Element]) -> None:
    group = SymmetryGroup(F, A, generators)
    assert 1 <= group.averaged <= MOST_AVERAGED
    assert group.averaged <= len(group) <= MOST_ELEMENTS
    assert group.elements[0] == Element.identity(F, A)
    for part in (group.elements, group.elements[: group.averaged]):
        own = set(part)
        assert len(own) == len(part)
        assert all(one.after(other) in own for one, other in product(part, part))
    if group.complete:
        assert set(generators) <= set(group.elements)


@pytest.mark.parametrize("name", GROUPS)
def test_a_group_has_as_many_elements_as_fit(name: str) -> None:
    generators, size, averaged = GROUPS[name]
    group = SymmetryGroup(F, A, generators)
    assert (len(group), group.averaged, group.complete) == (size, averaged, True)


def test_a_generator_with_which_the_group_is_too_large_is_left_out() -> None:
    exchange = Element((1, 0, 2, 3, 4), (1.0,) * F, (0, 1, 2, 3))
    group = SymmetryGroup(F, A, [exchange, cycle(5)])  # all 120 permutations of five
    assert group.elements == (Element.identity(F, A), exchange)
    assert not group.complete


@pytest.mark.parametrize(
    "wrong",
    [
        ((0, 0), (1.0, 1.0), (0, 1)),
        ((0, 1), (1.0, 2.0), (0, 1)),
        ((0, 1), (1.0,), (0, 1)),
        ((0, 1), (1.0, 1.0), (1, 2)),
    ],
)
def test_what_is_no_signed_permutation_is_refused(wrong: Any) -> None:
    with pytest.raises(ValueError, match="permutation|signs"):
        Element(*wrong)


def test_a_generator_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="does not fit 3"):
        SymmetryGroup(3, A, [MIRROR])


# --- learning ------------------------------------------------------------------------------------


@pytest.mark.parametrize("members", [1, 3])
@pytest.mark.parametrize("name", GROUPS)
def test_q_of_a_mirror_image_is_the_mirror_image_of_q(name: str, members: int) -> None:
    group = SymmetryGroup(F, A, GROUPS[name][0])
    agent = learner(group, members=members)
    live(agent, np.random.default_rng(0), 30)
    x = np.random.default_rng(1).standard_normal((20, F)).astype(np.float32)
    q = agent.q_values(x)
    assert q.std(axis=0).min() > 0.0
    for element in group.elements[: group.averaged]:
        image = element.of_input(x)
        np.testing.assert_allclose(agent.q_values(image), element.of_actions(q), atol=1e-6)
        one = agent.q_values(image[0])
        np.testing.assert_allclose(one, element.of_actions(q[0]), atol=1e-6)


@pytest.mark.parametrize("members", [1, 3])
@pytest.mark.parametrize("name", [None, *GROUPS])
def test_q_is_the_mean_of_what_each_network_says(name: str | None, members: int) -> None:
    group = None if name is None else SymmetryGroup(F, A, GROUPS[name][0])
    agent = learner(group, members=members)
    rng = np.random.default_rng(2)
    live(agent, rng, 20)
    for x in rng.standard_normal((20, F)):
        q = agent.member_q(x)
        assert q.shape == (members, A)
        np.testing.assert_allclose(q.mean(axis=0), agent.q_values(x), atol=1e-6)


@pytest.mark.parametrize("name", GROUPS)
def test_every_sample_drawn_is_an_image_and_every_image_is_drawn(name: str) -> None:
    group = SymmetryGroup(F, A, GROUPS[name][0])
    buffer = ReplayBuffer(
        F, A, capacity=1, batch_size=256, members=4, discount=0.9,
        rng=np.random.default_rng(0), symmetry=group,
    )  # fmt: skip
    rng = np.random.default_rng(1)
    x, next_x = rng.standard_normal((2, F)).astype(np.float32)
    allowed = np.array([True, False, False, True])
    buffer.add(x, 1, 0.5, next_x, False, False, allowed)
    drawn = buffer.sample()
    assert set(drawn.reward.flat) == {np.float32(0.5)}
    assert set(drawn.discount.flat) == {np.float32(0.9)}
    images = [(e.of_input(x), e.of_input(next_x), e.of_actions(~allowed)) for e in group.elements]
    expected = {
        (tuple(o), tuple(n), e.actions[1], tuple(f))
        for e, (o, n, f) in zip(group.elements, images, strict=True)
    }
    rows = zip(
        drawn.observation.reshape(-1, F), drawn.next_observation.reshape(-1, F),
        drawn.action.reshape(-1), drawn.forbidden.reshape(-1, A), strict=True,
    )  # fmt: skip
    assert {(tuple(o), tuple(n), int(a), tuple(f)) for o, n, a, f in rows} == expected


@given(st.integers(1, 40), st.sampled_from(sorted(GROUPS)))
@settings(max_examples=15, deadline=None)
def test_resume_equals_uninterrupted(steps: int, name: str) -> None:
    group = SymmetryGroup(F, A, GROUPS[name][0])
    whole, first, second = learner(group), learner(group), learner(group)
    live(whole, np.random.default_rng(2), steps)
    live(first, np.random.default_rng(2), steps)
    arrays, meta = first.state_dict()
    second.load_state_dict(arrays, meta)
    said = live(whole, np.random.default_rng(3), 20)
    assert live(second, np.random.default_rng(3), 20) == said
    assert_same_state(whole, second)


@pytest.mark.parametrize(
    ("group", "changes"),
    [
        (SymmetryGroup(F, A, [MIRROR]), {"symmetry": False}),
        (SymmetryGroup(F, A), {}),
        (None, {}),
    ],
)
def test_without_a_symmetry_nothing_is_another(
    group: SymmetryGroup | None, changes: dict[str, Any]
) -> None:
    agent, plain = learner(group, **changes), learner(None, symmetry=False)
    said = live(plain, np.random.default_rng(0), 30)
    assert live(agent, np.random.default_rng(0), 30) == said
    assert agent.symmetry is None


@pytest.mark.parametrize("members", [1, 2])
def test_the_exported_module_is_averaged_too(members: int) -> None:
    agent = learner(SymmetryGroup(F, A, [cycle(3)]), members=members)
    live(agent, np.random.default_rng(0), 20)
    x = np.random.default_rng(1).standard_normal((6, F)).astype(np.float32)
    exported = agent.module()(torch.from_numpy(x)).detach().numpy()
    np.testing.assert_allclose(exported, agent.q_values(x), atol=1e-6)
