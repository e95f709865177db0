"""The learner as a whole: proposals, updates, and continuing from what was saved."""

import json

import numpy as np
import onnxruntime
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.errors import RunError
from serp.learning.onnx_export import network_as_onnx
from tests.serp.learning.learners import A, F, assert_same_state, learner, live, set_q

GREEDY = {"epsilon_steps": 0, "epsilon_end": 0.0}
HERE = np.zeros(F, np.float32)


# --- proposing -----------------------------------------------------------------------------------


def test_greedy_is_the_lowest_of_the_best_explorable_or_not():
    agent = learner(**GREEDY)
    set_q(agent, [1.0, 2.0, 2.0])
    before = agent.state_dict()[1]
    assert agent.propose_greedily(HERE).action == 1
    assert agent.state_dict()[1] == before  # nothing was drawn
    proposal = agent.propose(HERE, np.array([True, False, False]))
    assert (proposal.action, proposal.exploratory) == (1, False)


def test_exploration_is_uniform_over_what_may_be_explored():
    agent = learner(epsilon_end=1.0)
    for explorable, allowed in (
        (np.array([True, False, True]), {0, 2}),
        (np.array([False, False, False]), {0, 1, 2}),
        (None, {0, 1, 2}),
    ):
        proposals = [agent.propose(HERE, explorable) for _ in range(600)]
        assert all(p.exploratory for p in proposals)
        counts = np.bincount([p.action for p in proposals], minlength=A)
        assert set(np.flatnonzero(counts)) == allowed
        assert counts[list(allowed)] == pytest.approx(600 / len(allowed), rel=0.25)


@pytest.mark.parametrize(
    ("imitates", "end", "steps", "expected"),
    [
        (False, 0.2, 4, [1.0, 0.8, 0.6, 0.4, 0.2, 0.2]),
        (False, 0.2, 0, [0.2] * 6),
        (True, 0.02, 4, [0.1, 0.08, 0.06, 0.04, 0.02, 0.02]),
    ],
)
def test_epsilon_falls_with_the_env_steps_remembered(imitates, end, steps, expected):
    agent = learner(imitates=imitates, epsilon_end=end, epsilon_steps=steps)
    seen = []
    for _ in expected:
        seen.append(agent.epsilon)
        agent.remember(HERE, 0, 0.0, HERE, False, False)
    assert seen == pytest.approx(expected)
    explored = [agent.propose(HERE).exploratory for _ in range(1000)]
    assert np.mean(explored) == pytest.approx(expected[-1], abs=0.05)


@pytest.mark.parametrize("options", [{}, {"layer_norm": True}, {"members": 3}], ids=str)
def test_q_is_the_same_of_one_of_many_and_exported(options):
    agent = learner(**options)
    live(agent, np.random.default_rng(0), 40)
    x = np.random.default_rng(1).standard_normal((6, F)).astype(np.float32)
    q = agent.learning.online.q(x)
    assert q.shape == (6, A) and q.dtype == np.float32 and q.std(axis=0).min() > 0.0
    exported = onnxruntime.InferenceSession(network_as_onnx(agent.learning.online))
    for how in (
        np.stack([agent.learning.online.q(row) for row in x]),
        np.stack([exported.run(None, {"x": row})[0] for row in x]),
    ):
        np.testing.assert_allclose(q, how, rtol=1e-4, atol=1e-5)
    # Whatever the type and the layout; and the caller's own.
    kept = q.copy()
    np.testing.assert_array_equal(agent.learning.online.q(x.astype(np.float64)), q)
    np.testing.assert_array_equal(agent.learning.online.q(np.asfortranarray(x)), q)
    agent.learning.online.q(-x)
    np.testing.assert_array_equal(q, kept)


@pytest.mark.parametrize("shape", [(), (F + 1,), (2, F - 1), (1, 1, F)])
def test_an_input_of_another_shape_is_refused(shape):
    agent = learner(**GREEDY)
    for method in (agent.learning.online.q, agent.propose_greedily, agent.propose):
        with pytest.raises(ValueError, match="must have shape"):
            method(np.zeros(shape, np.float32))
    with pytest.raises(ValueError, match="must have shape"):
        agent.propose(np.zeros((2, F), np.float32))  # one choice is made for one input


# --- when it learns ------------------------------------------------------------------------------


@pytest.mark.parametrize(("per_step", "expected"), [(0, 0), (0.1, 100), (0.5, 500), (2, 2000)])
def test_updates_per_step_never_drift(per_step, expected):
    agent = learner(updates_per_step=per_step, n_step=1, batch_size=1)
    agent.remember(HERE, 0, 0.0, HERE, False, False)
    losses = [agent.learn() for _ in range(1000)]
    assert agent.updates == expected
    assert sum(loss is not None for loss in losses) == min(expected, 1000)


# --- repeating and resuming ----------------------------------------------------------------------


VARIANTS = st.fixed_dictionaries(
    {
        "target_polyak": st.sampled_from([None, 0.05]),
        "imitates": st.booleans(),
        "hidden": st.sampled_from([(), (8,), (8, 5)]),
        "layer_norm": st.booleans(),
        "members": st.integers(1, 2),
        "n_step": st.integers(1, 4),
        "updates_per_step": st.sampled_from([0.3, 1, 2]),
        "learning_starts": st.sampled_from([1, 20]),
    }
)


@settings(deadline=None, max_examples=80)
@given(
    variant=VARIANTS,
    before=st.integers(0, 120),
    after=st.integers(1, 40),
    seed=st.integers(0, 1000),
)
def test_resume_equals_uninterrupted(variant, before, after, seed):
    variant |= {"epsilon_steps": 50, "buffer_size": 40}
    one, other = (learner(start, **variant) for start in (seed, seed + 1))
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
        ({"target_polyak": None}, "target network"),
        ({"buffer_size": 32}, "buffer_size"),
        ({"n_step": 2}, "n_step"),
    ],
)
def test_a_state_of_other_settings_is_refused_and_changes_nothing(change, message):
    saved = learner()
    live(saved, np.random.default_rng(0), 30)
    agent, same = learner(1, **change), learner(1, **change)
    with pytest.raises(RunError, match=message):
        agent.load_state_dict(*saved.state_dict())
    assert_same_state(agent, same)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda a, m: a.pop("target"), "target is missing"),
        (lambda a, m: a.update({"replay.reward": a["replay.reward"][:-1]}), "reward has shape"),
        (lambda a, m: a["replay.action"].fill(A), "action has values"),
        (lambda a, m: a["replay.imitated"].fill(A), "imitated has values"),
        (lambda a, m: m["replay"].update(pending_imitated=[A] * 2), "pending_imitated"),
        (lambda a, m: m["replay"].update(head=3), "head 3"),
    ],
)  # fmt: skip
def test_a_broken_state_is_refused_and_changes_nothing(spoil, message):
    source, rng = learner(imitates=True), np.random.default_rng(1)
    live(source, rng, 20)
    while len(source.state_dict()[1]["replay"]["pending_imitated"]) < 2:
        live(source, rng, 1)
    arrays, meta = source.state_dict()
    meta = json.loads(json.dumps(meta))
    spoil(arrays, meta)
    agent, same = learner(1, imitates=True), learner(1, imitates=True)
    with pytest.raises(RunError, match=message):
        agent.load_state_dict(arrays, meta)
    assert_same_state(agent, same)
