from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.errors import RunError, SettingsError
from serp.learning import DQN, Guidance, GuidedLearning, ReplayBuffer
from serp.learning.symmetry_group import Element, SymmetryGroup
from serp.settings import LearnerSettings
from tests.serp.learning.test_dqn import TARGETS, assert_same_state, set_q
from tests.serp.learning.test_dqn_learns import INPUTS, experience, optimal_q

F, A = 4, 3
MIRROR = Element((1, 0, 2, 3), (1.0, 1.0, -1.0, 1.0), (2, 1, 0))
GUIDES = {
    "imitation": GuidedLearning(margin_weight=0.7),
    "imitation without filter": GuidedLearning(margin_weight=0.7, q_filter=False),
    "bootstrap": GuidedLearning(bootstrap_guide=True),
    "both": GuidedLearning(margin_weight=0.7, margin=0.3, bootstrap_guide=True),
    "residual": GuidedLearning(residual=True),
    "residual and bootstrap": GuidedLearning(residual=True, bootstrap_guide=True),
}


def learner(
    guided: GuidedLearning | None,
    seed: int = 0,
    symmetry: SymmetryGroup | None = None,
    **changes: Any,
) -> DQN:
    small: dict[str, Any] = {
        "hidden": (8, 8), "batch_size": 8, "buffer_size": 64, "learning_starts": 1,
        "target_period": 7, "symmetry": symmetry is not None,
    }  # fmt: skip
    return DQN(F, A, LearnerSettings(**{**small, **changes}), seed, symmetry, guided)


def live(
    agent: DQN, rng: np.random.Generator, steps: int, image: Element | None = None
) -> list[Any]:
    """Random env steps with random guidance, or their images; all that the learner said."""
    image = image or Element.identity(F, A)
    said: list[Any] = []
    for _ in range(steps):
        x, next_x = (image.of_input(row.astype(np.float32)) for row in rng.standard_normal((2, F)))
        base, next_base = (image.of_actions(row) for row in rng.standard_normal((2, A)))
        said.append((agent.propose(x, None, base).action, agent.target_q(x, base).tolist()))
        action, guide_action, guide_next = (
            image.actions[a] if a >= 0 else a
            for a in (int(rng.integers(A)), *map(int, rng.integers(-1, A, 2)))
        )
        end = rng.random(2) < 0.1
        guidance = Guidance(guide_action, float(base[action]), guide_next, next_base)
        reward, allowed = float(rng.standard_normal()), image.of_actions(rng.random(A) < 0.7)
        agent.remember(
            x, action, reward, next_x, bool(end[0]), bool(end[1]), allowed,
            bool(rng.random() < 0.05), guidance,
        )  # fmt: skip
        said.append(agent.learn())
    return said


# --- settings ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "wrong",
    [
        {"margin": -0.1}, {"margin": float("nan")}, {"margin": "wide"}, {"margin_weight": -1},
        {"margin_weight": True}, {"q_filter": 1}, {"bootstrap_guide": "yes"}, {"residual": None},
        {"residual": True, "margin_weight": 0.5},
    ],
)  # fmt: skip
def test_what_is_out_of_range_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(SettingsError, match=list(wrong)[-1]):
        GuidedLearning(**wrong)


def test_the_defaults_learn_nothing_from_a_guide() -> None:
    assert not GuidedLearning().in_use
    assert all(guided.in_use for guided in GUIDES.values())


def test_the_weight_of_imitation_may_change_where_there_can_be_imitation() -> None:
    agent = learner(GUIDES["both"])
    assert agent.margin_weight == 0.7
    agent.margin_weight = 0.0
    agent.margin_weight = 2.0
    for wrong in (-0.1, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="must be a number"):
            agent.margin_weight = wrong
    for guided, why in ((None, "no guidance"), (GUIDES["residual"], "residual")):
        other = learner(guided)
        other.margin_weight = 0.0
        with pytest.raises(ValueError, match=why):
            other.margin_weight = 0.1


# --- what is remembered --------------------------------------------------------------------------


def test_guidance_is_needed_where_something_is_learned_from_it() -> None:
    x = np.zeros(F)
    learner(GuidedLearning()).remember(x, 0, 0.0, x, False, False)
    with pytest.raises(ValueError, match="needs its guidance"):
        learner(GUIDES["bootstrap"]).remember(x, 0, 0.0, x, False, False)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"action": A}, "cannot choose 3"),
        ({"next_action": -2}, "cannot choose -2"),
        ({"value": float("nan")}, "finite"),
        ({"next_values": np.array([0.0, np.inf, 0.0])}, "finite"),
        ({"next_values": np.zeros(A + 1)}, "shape"),
    ],
)
def test_guidance_that_does_not_fit_is_refused_and_changes_nothing(
    wrong: dict[str, Any], message: str
) -> None:
    agent, same = learner(GUIDES["both"]), learner(GUIDES["both"])
    x = np.zeros(F)
    guidance = Guidance(0, 0.0, 0, np.zeros(A))._replace(**wrong)
    with pytest.raises(ValueError, match=message):
        agent.remember(x, 0, 0.0, x, False, False, guidance=guidance)
    assert_same_state(agent, same)


@settings(deadline=None, max_examples=60)
@given(
    ends=st.lists(st.sampled_from(["", "", "", "terminated", "truncated"]), max_size=40),
    n=st.integers(1, 5),
)
def test_a_sample_has_the_guidance_of_its_first_and_of_its_last_state(
    ends: list[str], n: int
) -> None:
    memory = ReplayBuffer(
        1, A, capacity=50, batch_size=4, n_step=n, rng=np.random.default_rng(0), guided=True,
        protected_share=0.5, protected_early=5, protected_failing=50, failing_window=2,
    )  # fmt: skip
    for i, end in enumerate(ends):
        memory.add(
            np.array([i]), i % A, -1.0, np.array([i + 1000]), end == "terminated",
            end == "truncated", guidance=Guidance(i % 4 - 1, i / 2, i % 3 - 1, np.full(A, i)),
        )  # fmt: skip
    arrays, _ = memory.state_dict()
    for kind in ("ring", "early", "failing"):
        first = arrays[f"{kind}.observation"][:, 0].astype(int)
        last = arrays[f"{kind}.next_observation"][:, 0].astype(int) - 1000
        np.testing.assert_array_equal(arrays[f"{kind}.guide_action"], first % 4 - 1)
        np.testing.assert_array_equal(arrays[f"{kind}.guide_value"], first / 2)
        np.testing.assert_array_equal(arrays[f"{kind}.guide_next_action"], last % 3 - 1)
        np.testing.assert_array_equal(
            arrays[f"{kind}.guide_next_values"], np.repeat(last[:, None], A, 1)
        )
    if memory.size:
        batch = memory.sample()
        assert batch.guide is not None
        np.testing.assert_array_equal(batch.guide.value, batch.observation[..., 0] / 2)


def test_every_sample_drawn_is_an_image_guidance_included() -> None:
    turn = Element((1, 2, 0, 3), (1.0,) * F, (1, 2, 0))
    group = SymmetryGroup(F, A, [turn, MIRROR])
    memory = ReplayBuffer(
        F, A, capacity=2, batch_size=512, rng=np.random.default_rng(0), symmetry=group,
        guided=True,
    )  # fmt: skip
    x = np.arange(1.0, F + 1)
    values = np.array([1.0, 2.0, 3.0])
    said = (Guidance(0, 0.5, 2, values), Guidance(-1, 0.5, -1, values))
    for guidance in said:
        memory.add(x, 1, 0.0, x, False, False, guidance=guidance)
    batch = memory.sample()
    guide = batch.guide
    assert guide is not None
    assert set(guide.value.flat) == {0.5}
    expected = {
        (tuple(e.of_input(x)), *(e.actions[a] if a >= 0 else a for a in (g.action, g.next_action)),
         tuple(e.of_actions(values)))
        for e in group.elements for g in said
    }  # fmt: skip
    rows = zip(batch.observation[0], guide.action[0], guide.next_action[0], guide.next_values[0],
               strict=True)  # fmt: skip
    assert {(tuple(o), int(a), int(n), tuple(v)) for o, a, n, v in rows} == expected


# --- what is learned -----------------------------------------------------------------------------


def one_sample(agent: DQN, guidance: Guidance, **how: Any) -> float:
    """The loss on a memory of one sample of action 0 with reward 1."""
    x = np.zeros(F, np.float32)
    agent.remember(x, 0, 1.0, x, False, False, guidance=guidance, **how)
    loss = agent.pretrain(1)
    assert loss is not None
    return loss


EXACT: dict[str, Any] = {"n_step": 1, "clip_targets": False, "discount": 0.5, "target_period": 100}


def differ(agent: DQN, online: list[float], target: list[float]) -> None:
    """Makes Q the same in every state, in the network one and in its target another."""
    set_q(agent, target)
    arrays, meta = agent.state_dict()
    arrays["parameters"][:, -A:] = online
    agent.load_state_dict(arrays, meta)


def test_the_guides_action_is_a_candidate_by_target_q() -> None:
    for target, allowed, value in (
        ([0.0, 2.0, 3.0], None, 3.0),  # the guide's is better than the learner's action 1
        ([0.0, 2.0, 1.0], None, 2.0),
        ([0.0, 2.0, 3.0], np.array([True, True, False]), 2.0),
    ):
        agent = learner(GUIDES["bootstrap"], **EXACT)
        differ(agent, [0.0, 9.0, 0.0], target)
        guidance = Guidance(-1, 0.0, 2, np.zeros(A))
        loss = one_sample(agent, guidance, next_allowed=allowed)
        assert loss == pytest.approx((1.0 + 0.5 * value) ** 2)
    agent = learner(GUIDES["bootstrap"], **EXACT)
    differ(agent, [0.0, 9.0, 0.0], [0.0, 2.0, 3.0])
    assert one_sample(agent, Guidance(2, 0.0, -1, np.zeros(A))) == pytest.approx(4.0)


def test_the_filter_asks_the_target_network_about_the_learners_choice() -> None:
    td = (0.0 - 1.0) ** 2
    for target, filtered, weight in (
        ([0.0, 5.0, 5.0], True, 1.0),  # no lower: imitate
        ([0.0, 5.0, 4.9], True, 0.0),
        ([9.0, 5.0, 5.0], True, 1.0),  # action 0 is not what the learner would choose
        ([0.0, 5.0, 4.9], False, 1.0),
    ):
        agent = learner(
            GuidedLearning(margin_weight=0.5, margin=0.25, q_filter=filtered),
            **EXACT | {"discount": 0.0},
        )
        differ(agent, [0.0, 1.0, 0.0], target)
        loss = one_sample(agent, Guidance(2, 0.0, -1, np.zeros(A)))
        assert loss == pytest.approx(td + weight * 0.5 * (1.0 + 0.25))


def test_a_residual_is_what_the_guides_value_lacks() -> None:
    agent = learner(GUIDES["residual"], **EXACT)
    differ(agent, [0.5, 0.0, 0.0], [0.0, 1.0, 2.0])
    # Next state: the sums are [3.5, 2, 1] by the network, so action 0, worth 3 + 0 by the target.
    loss = one_sample(agent, Guidance(-1, 4.0, -1, np.array([3.0, 2.0, 1.0])))
    assert loss == pytest.approx(((4.0 + 0.5) - (1.0 + 0.5 * 3.0)) ** 2)
    # The sum is kept within the possible returns, which are 2 when every reward is 1.
    agent = learner(GUIDES["residual"], **EXACT | {"clip_targets": True})
    loss = one_sample(agent, Guidance(-1, 4.0, -1, np.array([30.0, 2.0, 1.0])))
    assert loss == pytest.approx((4.0 - 2.0) ** 2)


def test_a_residual_learner_starts_as_its_guide() -> None:
    agent = learner(GUIDES["residual"], epsilon_start=0.0, epsilon_end=0.0, members=2)
    x = np.random.default_rng(0).standard_normal((5, F))
    base = np.random.default_rng(1).standard_normal((5, A)).astype(np.float32)
    np.testing.assert_array_equal(agent.q_values(x, base), base)
    np.testing.assert_array_equal(agent.target_q(x, base), base)
    assert agent.greedy_batch(x, base).tolist() == base.argmax(1).tolist()
    for row, values in zip(x, base, strict=True):
        proposal = agent.propose(row, None, values)
        assert proposal.q is not None
        np.testing.assert_array_equal(proposal.q, values)
        assert proposal.action == agent.greedy(row, values) == values.argmax()
    np.testing.assert_array_equal(agent.q_values(x, base[0]), np.repeat(base[:1], 5, 0))
    for wrong in (np.zeros(A + 1), np.zeros((2, A))):
        with pytest.raises(ValueError, match="guide's values must have shape"):
            agent.q_values(x, wrong)


def test_target_q_is_that_of_the_target_network() -> None:
    for target, last in (("copy", [1.0, 2.0, 4.0]), ("none", [4.0, 3.0, 2.0])):
        agent = learner(None, members=2, **TARGETS[target])
        if target == "copy":
            differ(agent, [4.0, 3.0, 2.0], [1.0, 2.0, 4.0])
        else:
            set_q(agent, [4.0, 3.0, 2.0])
        q = agent.target_q(np.zeros(F))
        assert q.dtype == np.float32 and q.tolist() == last
        assert agent.target_q(np.zeros((1, F)), np.ones(A)).tolist() == [[v + 1 for v in last]]


class _Told(DQN):
    """Is told something wrong about every step of the corridor of `test_dqn_learns`."""

    wrong = optimal_q()[:, ::-1] + np.arange(5)[:, None]

    def remember(self, observation: Any, action: int, *rest: Any, **_: Any) -> None:
        state, after = int(observation.argmax()), int(rest[1].argmax())
        guidance = Guidance(0, self.wrong[state, action], 0, self.wrong[after])
        super().remember(observation, action, *rest, guidance=guidance)


@pytest.mark.parametrize("name", ["residual", "residual and bootstrap", "bootstrap"])
def test_a_wrong_guide_leaves_the_optimal_q_what_it_is(name: str) -> None:
    recipe = LearnerSettings(
        hidden=(32,), learning_rate=0.003, discount=0.8, batch_size=32, target_period=50,
        n_step=1, learning_starts=1,
    )  # fmt: skip
    agent = _Told(5, 2, recipe, 1, guided=GUIDES[name])
    experience(agent, 60, np.random.default_rng(0))
    agent.pretrain(2000)
    base = agent.wrong if GUIDES[name].residual else None
    np.testing.assert_allclose(agent.q_values(INPUTS, base), optimal_q(), atol=0.1)


@pytest.mark.parametrize(("filtered", "obeys"), [(False, True), (True, False)])
def test_only_the_filter_saves_the_learner_from_imitating_a_bad_guide(
    filtered: bool, obeys: bool
) -> None:
    recipe = LearnerSettings(
        hidden=(32,), learning_rate=0.003, discount=0.8, batch_size=32, target_period=50,
        n_step=1, learning_starts=1, epsilon_steps=0,
    )  # fmt: skip
    agent = _Told(5, 2, recipe, 1, guided=GuidedLearning(margin_weight=5.0, q_filter=filtered))
    agent.margin_weight = 0.0
    experience(agent, 60, np.random.default_rng(0))
    agent.pretrain(1500)
    agent.margin_weight = 5.0
    agent.pretrain(500)
    best = optimal_q().argmax(1)
    assert best.tolist() != [0] * 5
    chosen = agent.greedy_batch(INPUTS)
    assert chosen.tolist() == ([0] * 5 if obeys else best.tolist())


# --- symmetry ------------------------------------------------------------------------------------


def mirrored(agent: DQN) -> None:
    """Puts the mirror in front of the first layer and behind the last."""
    arrays, meta = agent.state_dict()
    for name in ("parameters", "target"):
        flat = arrays[name]
        first = flat[:, : F * 8].reshape(-1, F, 8)  # z = x · W, so W' = mirror · W
        signs = np.array(MIRROR.signs, np.float32)[:, None]
        first[:] = (first[:, list(MIRROR.columns)] * signs).copy()
        last = flat[:, -9 * A :].reshape(-1, 9, A)  # 8 rows of weights and the bias
        last[:] = MIRROR.of_actions(last)
    agent.load_state_dict(arrays, meta)


@pytest.mark.parametrize("name", GUIDES)
def test_a_mirrored_learner_learns_the_mirror_image(name: str) -> None:
    agent, other = learner(GUIDES[name]), learner(GUIDES[name])
    mirrored(other)
    live(agent, np.random.default_rng(0), 80)
    live(other, np.random.default_rng(0), 80, MIRROR)
    assert agent.updates > 60
    x = np.random.default_rng(1).standard_normal((20, F)).astype(np.float32)
    base = np.random.default_rng(2).standard_normal((20, A))
    np.testing.assert_allclose(
        other.q_values(MIRROR.of_input(x), MIRROR.of_actions(base)),
        MIRROR.of_actions(agent.q_values(x, base)),
        atol=1e-3,
    )


@pytest.mark.parametrize("name", GUIDES)
def test_q_of_a_mirror_image_is_the_mirror_image_of_q(name: str) -> None:
    group = SymmetryGroup(F, A, [MIRROR])
    agent = learner(GUIDES[name], symmetry=group, members=2)
    live(agent, np.random.default_rng(0), 40)
    x = np.random.default_rng(1).standard_normal((20, F)).astype(np.float32)
    base = np.random.default_rng(2).standard_normal((20, A))
    for q in (agent.q_values, agent.target_q):
        np.testing.assert_allclose(
            q(MIRROR.of_input(x), MIRROR.of_actions(base)),
            MIRROR.of_actions(q(x, base)),
            atol=1e-5,
        )


# --- repeating and resuming ----------------------------------------------------------------------


@pytest.mark.parametrize("symmetric", [False, True])
def test_a_guide_that_nothing_is_learned_from_changes_no_bit(symmetric: bool) -> None:
    group = SymmetryGroup(F, A, [MIRROR]) if symmetric else None
    plain, unused = learner(None, symmetry=group), learner(GuidedLearning(), symmetry=group)
    assert live(plain, np.random.default_rng(0), 60) == live(unused, np.random.default_rng(0), 60)
    assert_same_state(plain, unused)
    # Nor does one whose weight is taken away, but for what is remembered of it.
    silent = learner(GUIDES["imitation"], symmetry=group)
    silent.margin_weight = 0.0
    live(silent, np.random.default_rng(0), 60)
    for name in ("parameters", "target", "adam_second"):
        np.testing.assert_array_equal(silent.state_dict()[0][name], plain.state_dict()[0][name])


@settings(deadline=None, max_examples=40)
@given(
    name=st.sampled_from(sorted(GUIDES)),
    symmetric=st.booleans(),
    before=st.integers(0, 100),
    after=st.integers(1, 30),
    n=st.integers(1, 4),
    seed=st.integers(0, 1000),
)
def test_resume_equals_uninterrupted(
    name: str, symmetric: bool, before: int, after: int, n: int, seed: int
) -> None:
    group = SymmetryGroup(F, A, [MIRROR]) if symmetric else None
    options = {"n_step": n, "protected_share": 0.4, "protected_early": 9, "failing_window": 3}
    one = learner(GUIDES[name], seed, group, **options)
    other = learner(GUIDES[name], seed + 1, group, **options)
    world = np.random.default_rng(seed)
    live(one, world, before)
    live(other, np.random.default_rng(0), seed % 50)  # what was there before is gone
    arrays, meta = one.state_dict()
    other.load_state_dict(arrays, json.loads(json.dumps(meta)))
    again = np.random.default_rng(0)
    again.bit_generator.state = world.bit_generator.state
    assert live(one, world, after) == live(other, again, after)
    assert_same_state(one, other)


def test_the_state_of_a_learner_of_another_kind_is_refused_and_changes_nothing() -> None:
    for saved, here, message in (
        (None, GUIDES["both"], "without a guide"),
        (GUIDES["both"], None, "with a guide"),
    ):
        source = learner(saved)
        live(source, np.random.default_rng(0), 20)
        agent, same = learner(here, 1), learner(here, 1)
        with pytest.raises(RunError, match=message):
            agent.load_state_dict(*source.state_dict())
        assert_same_state(agent, same)


def test_a_broken_state_is_refused_and_changes_nothing() -> None:
    source = learner(GUIDES["both"])
    live(source, np.random.default_rng(1), 20)
    for spoil, message in (
        (lambda a, m: a["replay.ring.guide_action"].fill(A), "ring.guide_action has entries"),
        (
            lambda a, m: a["replay.ring.guide_next_action"].fill(-2),
            "ring.guide_next_action has entries",
        ),
        (lambda a, m: a.pop("replay.ring.guide_value"), "ring.guide_value is missing"),
        (lambda a, m: m["replay"]["pending_guide"].pop(), "pending_guide"),
        (lambda a, m: m["replay"].update(pending_guide=[[A, 0.0]] * 2), "pending_guide"),
    ):
        arrays, meta = source.state_dict()
        assert len(meta["replay"]["pending_guide"]) == 2
        spoil(arrays, meta)
        agent, same = learner(GUIDES["both"], 1), learner(GUIDES["both"], 1)
        with pytest.raises(RunError, match=message):
            agent.load_state_dict(arrays, meta)
        assert_same_state(agent, same)
