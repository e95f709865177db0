"""The tidying robot under serp: its file is short, and the first episode breaks nothing."""

import numpy as np
import pytest

pytest.importorskip("mujoco")

from serp.runs.trainer import Trainer
from serp.settings import resolve
from serp_adapters.tidy import ground, task
from serp_envs.tidy import MACROS
from tests.worlds import DOMAINS


def test_the_file_is_short_and_has_the_actions_of_the_robot():
    assert len((DOMAINS / "tidy.pddl").read_text(encoding="utf-8").splitlines()) <= 90
    with task().bind() as bound:
        assert {action for action in bound.actions.environment_action} == set(range(len(MACROS)))
        raw, _ = bound.reset(seed=0)
        state = bound.model.values(bound.ground(raw))
        assert sum(state[f"on-table {name}"] for name in ("block", "can", "bottle", "glass")) == 4
        assert 0.3 < state["battery"] < 0.8 and state["opening"] < 0.01
        batch = np.stack([raw, raw])
        np.testing.assert_array_equal(ground(batch)[1], ground(raw))


def test_the_first_episode_is_whole_and_does_nothing_flagged():
    with (
        task().bind() as bound,
        Trainer(bound, resolve("default", bound.task.settings), seed=1) as trainer,
    ):
        row = next(trainer.run())
        assert row.terminated and all(bound.env.unwrapped.tidy.values())
    assert row.unsafe_executed == row.avoidable_unsafe == row.unsafe_observed == 0
