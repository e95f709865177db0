from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.errors import RunError
from serp.learning import DQN
from serp.settings import LearnerSettings

F, A = 4, 3

TARGETS: dict[str, dict[str, Any]] = {
    "none": {"target_period": None},
    "copy": {"target_period": 7},
    "polyak": {"target_period": None, "target_polyak": 0.05},
}


def learner(seed: int | np.random.SeedSequence = 0, **settings: Any) -> DQN:
    small = {"hidden": (8, 8), "batch_size": 8, "buffer_size": 64, "learning_starts": 1}
    return DQN(F, A, LearnerSettings(**{**small, **settings}), seed)


def live(agent: DQN, rng: np.random.Generator, steps: int) -> list[Any]:
    """Random env steps; all that the learner said on the way."""
    said: list[Any] = []
    for _ in range(steps):
        x, next_x = rng.standard_normal((2, F)).astype(np.float32)
        proposal = agent.propose(x, rng.random(A) < 0.5)
        said.append((proposal.action, proposal.exploratory, agent.epsilon))
        if proposal.q is not None:
            said.append(proposal.q.tolist())
        end = rng.random(2) < 0.1
        agent.remember(
            x,
            proposal.action,
            float(rng.standard_normal()),
            next_x,
            bool(end[0]),
            bool(end[1]),
            rng.random(A) < 0.7,
            bool(rng.random() < 0.05),
        )
        said.append(agent.learn())
    return said


def assert_same_state(one: DQN, other: DQN) -> None:
    arrays, meta = one.state_dict()
    other_arrays, other_meta = other.state_dict()
    assert meta == other_meta
    assert arrays.keys() == other_arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(array, other_arrays[name], err_msg=name, strict=True)


def set_q(agent: DQN, q: list[float]) -> None:
    """Makes Q the same in every state, in the network and in its target."""
    arrays, meta = agent.state_dict()
    for name in ("parameters", "target"):
        if name in arrays:
            arrays[name][:] = 0.0
            arrays[name][:, -A:] = q  # the last layer's bias
    agent.load_state_dict(arrays, meta)


# --- proposing -----------------------------------------------------------------------------------


def test_greedy_is_the_lowest_of_the_best_and_draws_nothing() -> None:
    agent = learner(epsilon_start=0.0, epsilon_end=0.0)
    set_q(agent, [1.0, 2.0, 2.0])
    before = agent.state_dict()[1]
    x = np.zeros(F, np.float32)
    assert agent.greedy(x) == 1
    assert agent.greedy_batch(np.zeros((5, F), np.float32)).tolist() == [1] * 5
    assert agent.state_dict()[1] == before
    proposal = agent.propose(x)
    assert (proposal.action, proposal.exploratory) == (1, False)
    assert proposal.q is not None and proposal.q.tolist() == [1.0, 2.0, 2.0]


def test_exploration_is_uniform_over_what_may_be_explored() -> None:
    agent = learner(epsilon_start=1.0, epsilon_end=1.0)
    x = np.zeros(F, np.float32)
    for explorable, allowed in (
        (np.array([True, False, True]), {0, 2}),
        (np.array([False, False, False]), {0, 1, 2}),
        (None, {0, 1, 2}),
    ):
        proposals = [agent.propose(x, explorable) for _ in range(600)]
        assert all(p.exploratory and p.q is None for p in proposals)
        counts = np.bincount([p.action for p in proposals], minlength=A)
        assert set(np.flatnonzero(counts)) == allowed
        assert counts[list(allowed)] == pytest.approx(600 / len(allowed), rel=0.25)


def test_the_greedy_choice_is_not_restricted_by_what_may_be_explored() -> None:
    agent = learner(epsilon_start=0.0, epsilon_end=0.0)
    set_q(agent, [0.0, 0.0, 9.0])
    assert agent.propose(np.zeros(F), np.array([True, False, False])).action == 2


def test_epsilon_falls_with_the_env_steps_remembered() -> None:
    agent = learner(epsilon_start=1.0, epsilon_end=0.2, epsilon_steps=4)
    seen = []
    for _ in range(6):
        seen.append(agent.epsilon)
        agent.remember(np.zeros(F), 0, 0.0, np.zeros(F), False, False)
    assert seen == pytest.approx([1.0, 0.8, 0.6, 0.4, 0.2, 0.2])
    explored = [agent.propose(np.zeros(F)).exploratory for _ in range(1000)]
    assert np.mean(explored) == pytest.approx(0.2, abs=0.05)


def test_q_values_of_one_and_of_many_agree_with_the_module() -> None:
    for options in ({}, {"layer_norm": True}, {"members": 3}):
        agent = learner(**options)
        live(agent, np.random.default_rng(0), 40)
        x = np.random.default_rng(1).standard_normal((6, F)).astype(np.float32)
        q = agent.q_values(x)
        assert q.shape == (6, A) and q.dtype == np.float32
        single = np.stack([agent.q_values(row) for row in x])
        np.testing.assert_allclose(q, single, rtol=1e-4, atol=1e-5)
        exported = agent.module()(torch.from_numpy(x)).detach().numpy()
        np.testing.assert_allclose(q, exported, rtol=1e-4, atol=1e-5)


def test_q_values_are_the_callers_own() -> None:
    agent = learner()
    x = np.ones(F, np.float32)
    q = agent.q_values(x)
    kept = q.copy()
    agent.q_values(-x)
    np.testing.assert_array_equal(q, kept)


def test_any_float_type_and_layout_gives_the_same_bits() -> None:
    agent = learner()
    x = np.random.default_rng(0).standard_normal((5, F)).astype(np.float32)
    np.testing.assert_array_equal(agent.q_values(x.astype(np.float64)), agent.q_values(x))
    np.testing.assert_array_equal(agent.q_values(np.asfortranarray(x)), agent.q_values(x))


@pytest.mark.parametrize("shape", [(), (F + 1,), (2, F - 1), (1, 1, F)])
def test_an_input_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    x = np.zeros(shape, np.float32)
    agent = learner(epsilon_start=0.0, epsilon_end=0.0)
    for method in (agent.q_values, agent.greedy, agent.propose):
        with pytest.raises(ValueError, match="must have shape"):
            method(x)


def test_one_choice_is_made_for_one_input() -> None:
    agent = learner(epsilon_start=0.0, epsilon_end=0.0)
    for method in (agent.greedy, agent.propose):
        with pytest.raises(ValueError, match="must have shape"):
            method(np.zeros((2, F), np.float32))


# --- when it learns ------------------------------------------------------------------------------


@pytest.mark.parametrize(("per_step", "expected"), [(0, 0), (0.1, 100), (0.5, 500), (2, 2000)])
def test_updates_per_step_never_drift(per_step: float, expected: int) -> None:
    agent = learner(updates_per_step=per_step, n_step=1, batch_size=1)
    agent.remember(np.zeros(F), 0, 0.0, np.zeros(F), False, False)
    losses = [agent.learn() for _ in range(1000)]
    assert agent.updates == expected
    assert sum(loss is not None for loss in losses) == min(expected, 1000)


def test_nothing_is_learned_before_learning_starts() -> None:
    agent = learner(learning_starts=5, n_step=1)
    for step in range(1, 8):
        agent.remember(np.zeros(F), 0, 1.0, np.zeros(F), False, False)
        assert (agent.learn() is not None) == (step >= 5)


def test_pretraining_does_what_the_settings_say() -> None:
    agent = learner(pretrain_updates=12, learning_starts=1000, n_step=1)
    assert agent.pretrain() is None
    agent.remember(np.zeros(F), 0, 1.0, np.zeros(F), False, False)
    assert agent.pretrain() is not None
    assert agent.updates == 12
    assert agent.pretrain(0) is None
    agent.pretrain(3)
    assert agent.updates == 15


def test_the_target_network_follows_as_it_should() -> None:
    def parameters(agent: DQN) -> tuple[Any, Any]:
        arrays, _ = agent.state_dict()
        return arrays["parameters"], arrays.get("target")

    agent = learner(**TARGETS["copy"])
    live(agent, np.random.default_rng(0), 20)
    agent.pretrain(7 - agent.updates % 7)
    online, target = parameters(agent)
    np.testing.assert_array_equal(online, target)
    agent.pretrain(6)
    np.testing.assert_array_equal(parameters(agent)[1], target)
    agent.pretrain(1)
    assert not np.array_equal(parameters(agent)[1], target)
    np.testing.assert_array_equal(*parameters(agent))

    agent = learner(**TARGETS["polyak"])
    live(agent, np.random.default_rng(0), 20)
    _, before = parameters(agent)
    agent.pretrain(1)
    online, target = parameters(agent)
    np.testing.assert_allclose(target, before + 0.05 * (online - before), atol=1e-6)

    assert parameters(learner(**TARGETS["none"]))[1] is None


# --- what it learns from -------------------------------------------------------------------------


def one_sample(agent: DQN, *, reward: float = 1.0, allowed: Any = None, end: str = "") -> float:
    """The loss on a memory of one sample of action 0."""
    x = np.zeros(F, np.float32)
    agent.remember(x, 0, reward, x, end == "terminated", end == "truncated", allowed, failing=False)
    loss = agent.pretrain(1)
    assert loss is not None
    return loss


@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("target", TARGETS)
def test_a_forbidden_action_never_enters_the_target(double: bool, target: str) -> None:
    options = TARGETS[target] | {"n_step": 1, "clip_targets": False, "discount": 0.5}
    agent = learner(double=double, **options)
    set_q(agent, [0.0, 4.0, 1e6])
    loss = one_sample(agent, allowed=np.array([True, True, False]))
    assert loss == pytest.approx((0.0 - (1.0 + 0.5 * 4.0)) ** 2, rel=1e-5)

    agent = learner(double=double, **options)
    set_q(agent, [0.0, 4.0, 8.0])
    loss = one_sample(agent, allowed=np.zeros(A, np.bool_))
    assert loss == pytest.approx((0.0 - (1.0 + 0.5 * 8.0)) ** 2, rel=1e-5)


def test_double_chooses_by_the_network_and_values_by_its_target() -> None:
    losses = {}
    for double in (False, True):
        agent = learner(
            double=double, n_step=1, clip_targets=False, discount=0.5, target_period=100
        )
        set_q(agent, [0.0, 2.0, 8.0])
        arrays, meta = agent.state_dict()
        arrays["parameters"][:, -A:] = [0.0, 9.0, 1.0]
        agent.load_state_dict(arrays, meta)
        losses[double] = one_sample(agent)
    assert losses[False] == pytest.approx((1.0 + 0.5 * 8.0) ** 2)
    assert losses[True] == pytest.approx((1.0 + 0.5 * 2.0) ** 2)


def test_terminal_steps_end_and_truncated_ones_do_not() -> None:
    for end, value in (("terminated", 0.0), ("truncated", 8.0)):
        agent = learner(n_step=3, clip_targets=False, discount=0.5)
        set_q(agent, [0.0, 2.0, 8.0])
        assert one_sample(agent, end=end) == pytest.approx((1.0 + 0.5 * value) ** 2)


def test_estimated_values_are_clipped_to_the_possible_returns() -> None:
    # The reward is always 1, γ = 0.5: an endless episode is worth 2.
    for q, value in ((1e6, 2.0), (-1e6, 2.0)):
        agent = learner(n_step=1, discount=0.5)
        set_q(agent, [0.0, q, q])
        loss = one_sample(agent, allowed=np.array([False, True, True]))
        assert loss == pytest.approx((1.0 + 0.5 * value) ** 2)
    # The bounds are in scaled units, as Q is.
    agent = learner(n_step=1, discount=0.5, reward_scale=0.5)
    set_q(agent, [0.0, 1e6, 0.0])
    assert one_sample(agent, reward=4.0) == pytest.approx((2.0 + 0.5 * 4.0) ** 2)
    assert agent.value_bounds == (4.0, 4.0)


def test_huber_and_the_scale_of_rewards() -> None:
    agent = learner(loss="huber", n_step=1, reward_scale=0.5)
    set_q(agent, [0.0, 0.0, 0.0])
    assert one_sample(agent, reward=10.0, end="terminated") == pytest.approx(5.0 - 0.5)


def test_members_learn_apart_and_answer_together() -> None:
    agent = learner(members=3)
    live(agent, np.random.default_rng(0), 60)
    parameters = agent.state_dict()[0]["parameters"]
    assert len(parameters) == 3
    assert not np.array_equal(parameters[0], parameters[1])
    x = np.ones((1, F), np.float32)
    each = [member(torch.from_numpy(x)) for member in agent.module().members]  # type: ignore[union-attr]
    np.testing.assert_allclose(
        agent.q_values(x), torch.stack(each).mean(0).detach().numpy(), rtol=1e-4, atol=1e-5
    )


# --- what states are worth to it -----------------------------------------------------------------


@pytest.mark.parametrize("scale", [1.0, 0.5, 4.0])
def test_the_newest_values_are_of_the_best_action_allowed_in_units_of_reward(scale: float) -> None:
    agent = learner(n_step=1, reward_scale=scale)
    for number, allowed in enumerate(([1, 1, 1], [1, 1, 0], [1, 0, 0], [0, 0, 0], None)):
        mask = None if allowed is None else np.array(allowed, np.bool_)
        agent.remember(np.zeros(F), 0, 1.0, np.full(F, number), False, False, mask)
    set_q(agent, [-3.0, 4.0, 9.0])
    inputs, values = agent.newest_values(10)
    assert inputs[:, 0].tolist() == [0, 1, 2, 3, 4]
    # Where nothing is allowed, all is: somebody has to do something.
    assert values.tolist() == [9.0 / scale, 4.0 / scale, -3.0 / scale, 9.0 / scale, 9.0 / scale]
    assert values.dtype == np.float64


def test_the_newest_values_leave_out_where_the_episode_ended() -> None:
    agent = learner(n_step=2)
    for number, (terminated, truncated) in enumerate(
        [(False, False), (True, False), (False, False), (False, True), (True, True), (False, False)]
    ):
        agent.remember(np.zeros(F), 0, 1.0, np.full(F, number), terminated, truncated)
    # Two rewards each: the first sample leads to 1 and so does the second, and there it ended.
    inputs, _ = agent.newest_values(10)
    assert inputs[:, 0].tolist() == [3, 3]
    assert agent.newest_values(1)[0].shape == (0, F)  # the newest sample is one that ended


def test_the_newest_values_are_of_as_many_samples_as_wanted() -> None:
    agent = learner(n_step=1, buffer_size=10, failing_window=1)
    for number in range(14):
        agent.remember(np.zeros(F), 0, 1.0, np.full(F, number), False, False)
    for count in (1, 4, 10, 50):
        inputs, values = agent.newest_values(count)
        assert inputs[:, 0].tolist() == list(range(max(4, 14 - count), 14))
        np.testing.assert_array_equal(values, agent.q_values(inputs).max(axis=1))


def test_who_remembers_nothing_knows_no_values() -> None:
    inputs, values = learner().newest_values(5)
    assert (inputs.shape, values.shape) == ((0, F), (0,))
    agent = learner(n_step=1)
    agent.remember(np.zeros(F), 0, 1.0, np.zeros(F), True, False)
    inputs, values = agent.newest_values(5)
    assert (inputs.shape, values.shape) == ((0, F), (0,))


def test_asking_for_values_changes_nothing() -> None:
    one, other = learner(), learner()
    for agent in (one, other):
        live(agent, np.random.default_rng(0), 60)
    one.newest_values(20)
    assert_same_state(one, other)
    assert live(one, np.random.default_rng(1), 20) == live(other, np.random.default_rng(1), 20)


# --- repeating and resuming ----------------------------------------------------------------------


def test_equal_seeds_give_equal_bits_and_leave_the_sequence_alone() -> None:
    sequence = np.random.SeedSequence(5)
    one, other = learner(sequence), learner(sequence)
    said = [live(agent, np.random.default_rng(0), 60) for agent in (one, other)]
    assert said[0] == said[1]
    assert_same_state(one, other)
    assert sequence.n_children_spawned == 0
    assert not np.array_equal(
        learner(6).state_dict()[0]["parameters"], learner(7).state_dict()[0]["parameters"]
    )


VARIANTS = st.fixed_dictionaries(
    {
        "target": st.sampled_from(sorted(TARGETS)),
        "hidden": st.sampled_from([(), (8,), (8, 5)]),
        "layer_norm": st.booleans(),
        "members": st.integers(1, 2),
        "double": st.booleans(),
        "n_step": st.integers(1, 4),
        "clip_targets": st.booleans(),
        "loss": st.sampled_from(["mse", "huber"]),
        "gradient_clip": st.sampled_from([None, 0.1]),
        "updates_per_step": st.sampled_from([0.3, 1, 2]),
        "protected_share": st.sampled_from([0.0, 0.4]),
        "learning_starts": st.sampled_from([1, 20]),
    }
)


@settings(deadline=None, max_examples=60)
@given(
    variant=VARIANTS,
    before=st.integers(0, 120),
    after=st.integers(1, 40),
    seed=st.integers(0, 1000),
)
def test_resume_equals_uninterrupted(
    variant: dict[str, Any], before: int, after: int, seed: int
) -> None:
    options = {k: v for k, v in variant.items() if k != "target"}
    options |= TARGETS[variant["target"]] | {
        "epsilon_steps": 50,
        "protected_early": 9,
        "protected_failing": 9,
        "failing_window": 3,
    }
    one, other = learner(seed, **options), learner(seed + 1, **options)
    world = np.random.default_rng(seed)
    live(one, world, before)
    live(other, np.random.default_rng(0), seed % 50)  # what was there before is gone
    arrays, meta = one.state_dict()
    assert all(array.base is None for array in arrays.values())
    other.load_state_dict(arrays, json.loads(json.dumps(meta)))
    world_again = np.random.default_rng(0)
    world_again.bit_generator.state = world.bit_generator.state
    assert live(one, world, after) == live(other, world_again, after)
    assert_same_state(one, other)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"hidden": (8,)}, "parameters"),
        ({"members": 2}, "parameters"),
        ({"target_period": None}, "target network"),
        ({"buffer_size": 32}, "buffer_size"),
    ],
)
def test_a_state_of_other_settings_is_refused_and_changes_nothing(
    change: dict[str, Any], message: str
) -> None:
    saved = learner()
    live(saved, np.random.default_rng(0), 30)
    agent, same = learner(1, **change), learner(1, **change)
    with pytest.raises(RunError, match=message):
        agent.load_state_dict(*saved.state_dict())
    assert_same_state(agent, same)


def test_a_state_without_a_needed_array_is_refused() -> None:
    arrays, meta = learner().state_dict()
    del arrays["target"]
    with pytest.raises(RunError, match="target is missing"):
        learner().load_state_dict(arrays, meta)
