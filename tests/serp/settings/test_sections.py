"""Sections of the settings: what is accepted, and what is refused by name."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from serp.errors import SettingsError
from serp.settings import Section, Settings
from serp.settings.sections import LearnerSettings, TrainingSettings

OUTSIDE: dict[str, list[Any]] = {
    "planner.name": [3],
    "planner.depth": [0, 2.0, True, "5", 10_001, 10**30],
    "planner.discount": [0.0, 1.01, math.nan, "high"],
    "planner.repeat": [0, 10**30],
    "planner.max_nodes": [-1],
    "planner.accepted_risk": [-0.1, 1.0],
    "planner.leaf_value": ["sometimes", "Always", "", None, True, ["always"]],
    "adaptation.mode": ["on", None, True],
    "adaptation.nonlinear": [1, "yes"],
    "adaptation.min_visits": [-1, 1.5, True, 2**70],
    "arbiter.rho": [-0.1, 1.1, "high", None, True, math.nan],
    "arbiter.rho_increment": [-0.1, 2],
    "arbiter.rho_unit": [3, None],
    "arbiter.rho_max": [1.5],
    "arbiter.confidence_margin": [-1, math.nan, math.inf],
    "arbiter.imitation_weight": [-1, None],
    "arbiter.r_min": ["low", math.nan, math.inf, True],
    "arbiter.veto_horizon": ["far"],
    "arbiter.max_lookahead_failures": [-1, 0.5, 10**400],
    "arbiter.exploration_slack": [-1, math.nan, "all"],
    "arbiter.after_veto": ["nobody"],
    "arbiter.unmodelled": [True],
    "arbiter.indifferent": ["last"],
    "guide.strategy": [3, None, ["residual"]],
    "guide.jump_stages": [0, 1.5, True, "ten"],
    "guide.jump_tolerance": [-0.1, math.nan],
    "guide.restrict_slack": [-1, math.inf, None],
    "guide.imitation_steps": [0, -1],
    "guide.margin": [-0.8, "wide"],
    "learner.name": [None],
    "learner.hidden": [(0,), (64, 1.5), 64, "64", (True,), [2**70], np.ones((2, 2))],
    "learner.layer_norm": [1],
    "learner.members": [0, 2**70],
    "learner.symmetry": [1],
    "learner.learning_rate": [0.0, math.nan, math.inf],
    "learner.discount": [1.0, -0.1, "0.9", False],
    "learner.batch_size": [0, 64.0, True],
    "learner.updates_per_step": [-1, math.inf],
    "learner.target_period": [0, 1.5],
    "learner.target_polyak": [0.0, 1.5],
    "learner.double": [None],
    "learner.n_step": [0, 10**400],
    "learner.clip_targets": ["yes"],
    "learner.mask_targets": [1],
    "learner.loss": ["mae", ["mse"], np.array(["mse", "huber"])],
    "learner.reward_scale": [0],
    "learner.gradient_clip": [0.0, "10"],
    "learner.epsilon_start": [1.1],
    "learner.epsilon_end": [-0.1],
    "learner.epsilon_steps": [-1],
    "learner.buffer_size": [0],
    "learner.learning_starts": [-1],
    "learner.protected_share": [1.01],
    "learner.protected_early": [-1],
    "learner.protected_failing": [2.5],
    "learner.failing_window": [0, "10"],
    "learner.pretrain_updates": [-1],
    "training.reward": ["both", 3],
    "training.inputs": ["pixels", ["both"], np.array(["both", "state"])],
    "training.random_steps": [-1, "many"],
    "training.env_steps": [0, 1.5, True],
    "training.units": [0],
    "training.episode_steps": [0],
    "training.checkpoint_seconds": ["15", math.nan, -1.0],
    "training.slow_step_seconds": [0, "30"],
    "training.tensorboard": [1],
}


@pytest.mark.parametrize("name", OUTSIDE)
def test_a_value_outside_its_range_is_refused_by_name_and_value(name: str) -> None:
    section, setting = name.split(".")
    for value in OUTSIDE[name]:
        with pytest.raises(SettingsError) as refusal:
            Settings().replace({section: {setting: value}})
        message = str(refusal.value)
        assert message.startswith(f"{name} must be "), message
        assert message.endswith(f"not {value!r}") or isinstance(value, np.ndarray | list | tuple)


def test_every_setting_has_a_range_and_a_description() -> None:
    every = set()
    for section, values in Settings():
        for setting, field in type(values).model_fields.items():
            every.add(f"{section}.{setting}")
            assert field.description, f"{section}.{setting} has no description"
    assert set(OUTSIDE) == every


def test_settings_that_contradict_each_other_are_refused() -> None:
    for changes, said in (
        ({"target_period": 200, "target_polyak": 0.01}, "target_polyak is 0.01.*target_period is"),
        ({"buffer_size": 8, "failing_window": 9}, "failing_window is 9.*buffer_size, which is 8"),
    ):
        with pytest.raises(SettingsError, match=said):
            LearnerSettings(**changes)
    with pytest.raises(SettingsError, match="rho is 0.5, but must be at most rho_max"):
        Settings().replace({"arbiter": {"rho": 0.5, "rho_max": 0.4}})


def test_numpys_numbers_are_taken_over_as_pythons() -> None:
    changes: dict[str, dict[str, Any]] = {
        "planner": {"depth": np.int64(3), "discount": np.float64(0.5)},
        "adaptation": {"min_visits": np.int8(2), "nonlinear": np.False_},
        "arbiter": {"rho": np.float32(0.5), "r_min": np.int16(-1)},
        "learner": {"hidden": np.array([8, 8]), "double": np.True_, "members": np.uint8(2)},
        "training": {"env_steps": np.int32(9), "checkpoint_seconds": np.float64(2)},
    }
    settings = Settings().replace(changes)
    assert settings.learner.hidden == (8, 8)
    for _, section in settings:
        for _, value in section:
            assert type(value) in (int, float, bool, str, tuple, type(None))
    assert TrainingSettings(env_steps=np.int64(3)) == TrainingSettings(env_steps=3)


def test_a_section_cannot_be_changed_in_place() -> None:
    section: Section = TrainingSettings()
    with pytest.raises(ValueError, match="frozen"):
        section.env_steps = 3  # type: ignore[attr-defined]
