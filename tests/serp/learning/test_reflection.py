"""A learner with a reflection treats both sides alike."""

from __future__ import annotations

from typing import Any

import numpy as np
import onnxruntime
import pytest

from serp.learning.dqn import DQN
from serp.learning.reflection import Reflection
from serp.learning.replay import ReplayBuffer, SampleSpec
from serp.settings import LearnerSettings
from tests.serp.learning.learners import A, F, live

MIRROR = Reflection((1, 0, 2, 3), (1, 1, -1, 1), (2, 1, 0))
SMALL = {"hidden": (8, 8), "batch_size": 8, "buffer_size": 64, "learning_starts": 1}


@pytest.mark.parametrize("members", [1, 3])
def test_q_of_a_mirror_image_is_the_mirror_image_of_q_also_exported(members: int) -> None:
    agent = DQN(F, A, LearnerSettings(**SMALL, members=members), 0, True, MIRROR)
    live(agent, np.random.default_rng(0), 40)
    x = np.random.default_rng(1).standard_normal((6, F)).astype(np.float32)
    q = agent.q_values(x)
    exported = onnxruntime.InferenceSession(agent.as_onnx())
    for image in (
        MIRROR.of_actions(agent.q_values(MIRROR.of_inputs(x))),
        np.stack([agent.q_values(row) for row in x]),
        np.stack([exported.run(None, {"x": row})[0] for row in x]),
    ):
        np.testing.assert_allclose(image, q, rtol=1e-4, atol=1e-5)


def test_every_sample_drawn_is_the_stored_one_or_its_mirror_image_and_both_are_drawn() -> None:
    settings = LearnerSettings(buffer_size=8, batch_size=256, members=2, n_step=1)
    memory = ReplayBuffer(SampleSpec(F, A, True), settings, np.random.default_rng(0), MIRROR)
    x, next_x = np.random.default_rng(1).standard_normal((2, F)).astype(np.float32)
    allowed = np.array([True, True, False])
    for imitated in (0, -1):
        memory.add(x, 2, 0.5, next_x, False, False, allowed, imitated)
    of = MIRROR.of_inputs
    expected: list[tuple[Any, ...]] = [
        (x.tolist(), 2, next_x.tolist(), (~allowed).tolist(), 0),
        (x.tolist(), 2, next_x.tolist(), (~allowed).tolist(), -1),
        (of(x).tolist(), 0, of(next_x).tolist(), [True, False, False], 2),
        (of(x).tolist(), 0, of(next_x).tolist(), [True, False, False], -1),
    ]
    batch = memory.sample()
    columns = (
        batch.observation.reshape(-1, F), batch.action.ravel(),
        batch.next_observation.reshape(-1, F),
        batch.forbidden.reshape(-1, A), batch.imitated.ravel(),
    )  # fmt: skip
    drawn = list(zip(*(column.tolist() for column in columns), strict=True))
    assert all(sample in expected for sample in drawn)
    assert all(sample in drawn for sample in expected)


@pytest.mark.parametrize(
    "wrong",
    [
        ((1, 2, 0), (1, 1, 1), (0,)),
        ((0, 0), (1, 1), (0,)),
        ((0, 1), (1, 2), (0,)),
        ((1, 0), (1, -1), (0,)),
        ((0, 1), (1,), (0,)),
        ((0, 1), (1, 1), (0, 7)),
    ],
)
def test_what_is_not_its_own_inverse_is_refused(wrong: Any) -> None:
    with pytest.raises(ValueError):
        Reflection(*wrong)
