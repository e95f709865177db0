from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.learning import DQN, DQNSettings, Guidance, GuidedLearning, SideBySide
from serp.learning.symmetry import Element, SymmetryGroup
from tests.serp.learning.test_dqn import TARGETS, assert_same_state

F, A = 4, 3
MIRROR = Element((1, 0, 2, 3), (1.0, 1.0, -1.0, 1.0), (2, 1, 0))
GUIDES = [
    None,
    GuidedLearning(margin_weight=0.7, bootstrap_guide=True),
    GuidedLearning(residual=True),
]


def learner(
    seed: int, *, symmetric: bool = False, guided: GuidedLearning | None = None, **changes: Any
) -> DQN:
    small: dict[str, Any] = {
        "hidden": (8, 8), "batch_size": 8, "buffer_size": 64, "learning_starts": 1,
        "target_period": 7, "symmetry": symmetric, "epsilon_steps": 30,
    }  # fmt: skip
    group = SymmetryGroup(F, A, [MIRROR]) if symmetric else None
    return DQN(F, A, DQNSettings(**{**small, **changes}), seed, group, guided)


def step(agent: DQN, rng: np.random.Generator) -> list[Any]:
    """One random env step; what the learner said before it."""
    x, next_x = rng.standard_normal((2, F)).astype(np.float32)
    base, next_base = rng.standard_normal((2, A))
    proposal = agent.propose(x, None, base)
    end = rng.random(2) < 0.1
    agent.remember(
        x, proposal.action, float(rng.standard_normal()), next_x, bool(end[0]), bool(end[1]),
        rng.random(A) < 0.7, bool(rng.random() < 0.05),
        Guidance(int(rng.integers(-1, A)), float(base[0]), int(rng.integers(-1, A)), next_base),
    )  # fmt: skip
    return [proposal.action, agent.q_values(x).tolist(), agent.target_q(x).tolist()]


VARIANTS = st.fixed_dictionaries(
    {
        "target": st.sampled_from(sorted(TARGETS)),
        "hidden": st.sampled_from([(), (8,), (8, 5), (64, 64)]),
        "batch_size": st.sampled_from([1, 8, 33]),
        "layer_norm": st.booleans(),
        "members": st.integers(1, 3),
        "symmetric": st.booleans(),
        "double": st.booleans(),
        "n_step": st.integers(1, 3),
        "loss": st.sampled_from(["mse", "huber"]),
        "gradient_clip": st.sampled_from([None, 0.1]),
        "updates_per_step": st.sampled_from([0.3, 1, 2]),
        "learning_starts": st.sampled_from([1, 10]),
        "guided": st.sampled_from(GUIDES),
    }
)


@settings(deadline=None, max_examples=30)
@given(variant=VARIANTS, count=st.integers(1, 5), seed=st.integers(0, 1000))
def test_every_learner_is_bit_for_bit_what_it_is_alone(
    variant: dict[str, Any], count: int, seed: int
) -> None:
    options = {k: v for k, v in variant.items() if k != "target"} | TARGETS[variant["target"]]
    alone = [learner(seed + i, **options) for i in range(count)]
    beside = [learner(seed + i, **options) for i in range(count)]
    worlds, again = ([np.random.default_rng(i) for i in range(count)] for _ in range(2))
    stages = np.random.default_rng(seed)
    for i in range(count):  # they have lived for different times
        for _ in range(int(stages.integers(0, 15))):
            assert step(alone[i], worlds[i]) == step(beside[i], again[i])
            assert alone[i].learn() == beside[i].learn()
    together = SideBySide(beside)
    for i in range(count):
        assert_same_state(alone[i], beside[i])
    for _ in range(20):
        numbers = [int(i) for i in np.flatnonzero(stages.random(count) < 0.8)]
        for i in numbers:
            assert step(alone[i], worlds[i]) == step(beside[i], again[i])
        if len(numbers) == count:
            losses = together.learn()
        else:
            stages.shuffle(numbers)
            losses = together.learn(numbers)
        assert losses == [alone[i].learn() for i in numbers]
    for i in range(count):
        assert_same_state(alone[i], beside[i])


def test_what_they_learned_from_is_one_pass_not_many(monkeypatch: pytest.MonkeyPatch) -> None:
    beside = [learner(i, members=2, n_step=1) for i in range(4)]
    together = SideBySide(beside)
    for agent in beside:
        step(agent, np.random.default_rng(0))
    for agent in beside:
        monkeypatch.setattr(agent, "update", None)  # nobody may update on its own
    assert all(loss is not None for loss in together.learn())
    assert [agent.updates for agent in beside] == [1] * 4


def test_a_learner_beside_others_may_be_saved_restored_and_updated_on_its_own() -> None:
    alone = [learner(i, members=2, layer_norm=True) for i in range(3)]
    beside = [learner(i, members=2, layer_norm=True) for i in range(3)]
    together = SideBySide(beside)
    world, again = np.random.default_rng(0), np.random.default_rng(0)

    def live(steps: int) -> None:
        for _ in range(steps):
            for one, other in zip(alone, beside, strict=True):
                assert step(one, world) == step(other, again)
            assert together.learn() == [agent.learn() for agent in alone]

    live(12)
    assert alone[1].pretrain(3) == beside[1].pretrain(3)
    live(5)
    saved = beside[0].state_dict()
    for kind in (alone, beside):
        kind[2].load_state_dict(*saved)
    live(9)
    for one, other in zip(alone, beside, strict=True):
        assert_same_state(one, other)
    elsewhere = learner(7, members=2, layer_norm=True)
    elsewhere.load_state_dict(*beside[1].state_dict())
    assert_same_state(elsewhere, alone[1])


def test_the_weight_of_imitation_is_each_learners_own() -> None:
    alone, beside = ([learner(i, guided=GUIDES[1]) for i in range(3)] for _ in range(2))
    together = SideBySide(beside)
    world, again = np.random.default_rng(0), np.random.default_rng(0)
    for t in range(30):
        for i, (one, other) in enumerate(zip(alone, beside, strict=True)):
            one.margin_weight = other.margin_weight = float(i) if t < 20 else 0.0
            assert step(one, world) == step(other, again)
        assert together.learn() == [agent.learn() for agent in alone]
    for one, other in zip(alone, beside, strict=True):
        assert_same_state(one, other)


@pytest.mark.parametrize(
    ("others", "message"),
    [
        ([], "no learner"),
        ([learner(0), learner(1, members=2)], "equal settings"),
        ([learner(0), learner(1, guided=GUIDES[1])], "equal ways to learn from a guide"),
        ([learner(0), DQN(F + 1, A, learner(0).settings, 0)], "equal inputs"),
        ([learner(0), DQN(F, A + 1, learner(0).settings, 0)], "equal actions"),
        ([learner(0)] * 2, "with itself"),
    ],
)
def test_learners_that_differ_are_refused(others: list[DQN], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SideBySide(others)


def test_a_learner_can_be_taken_elsewhere_and_is_then_refused_here() -> None:
    agents = [learner(i) for i in range(3)]
    first = SideBySide(agents)
    second = SideBySide(agents[1:])
    with pytest.raises(ValueError, match="side by side with others"):
        first.learn()
    assert first.learn([0]) == [None]  # it has seen nothing yet
    assert second.learn() == [None, None]
