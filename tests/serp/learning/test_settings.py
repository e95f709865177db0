from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import numpy as np
import pytest

from serp.errors import SettingsError
from serp.learning import DQNSettings

OUTSIDE: list[tuple[str, Any]] = [
    ("hidden", (0,)),
    ("hidden", (64, 1.5)),
    ("hidden", 64),
    ("hidden", "64"),
    ("hidden", (True,)),
    ("layer_norm", 1),
    ("symmetry", 1),
    ("members", 0),
    ("learning_rate", 0.0),
    ("learning_rate", math.nan),
    ("learning_rate", math.inf),
    ("discount", 1.0),
    ("discount", -0.1),
    ("discount", "0.9"),
    ("discount", False),
    ("batch_size", 0),
    ("batch_size", 64.0),
    ("batch_size", True),
    ("updates_per_step", -1),
    ("target_period", 0),
    ("target_polyak", 0.0),
    ("target_polyak", 1.5),
    ("double", None),
    ("n_step", 0),
    ("clip_targets", "yes"),
    ("mask_targets", 1),
    ("loss", "mae"),
    ("reward_scale", 0),
    ("gradient_clip", 0.0),
    ("epsilon_start", 1.1),
    ("epsilon_end", -0.1),
    ("epsilon_steps", -1),
    ("buffer_size", 0),
    ("learning_starts", -1),
    ("protected_share", 1.01),
    ("protected_early", -1),
    ("protected_failing", 2.5),
    ("failing_window", 0),
    ("failing_window", "10"),
    ("target_period", 1.5),
    ("loss", ["mse"]),
    ("gradient_clip", "10"),
    ("pretrain_updates", -1),
    ("hidden", [2**70]),
    ("members", 2**70),
    ("n_step", 10**400),
]


@pytest.mark.parametrize(("name", "value"), OUTSIDE)
def test_a_value_outside_its_range_is_refused_by_name_value_and_range(
    name: str, value: Any
) -> None:
    with pytest.raises(SettingsError) as refusal:
        DQNSettings(**{name: value})
    message = str(refusal.value)
    assert f"setting {name} is {value!r}, but must be " in message
    assert message.split("must be ")[1]


def test_every_setting_has_a_range_that_is_checked() -> None:
    assert {name for name, _ in OUTSIDE} == {f.name for f in dataclasses.fields(DQNSettings)}


def test_both_ways_to_follow_at_once_are_refused() -> None:
    with pytest.raises(SettingsError, match="target_polyak is 0.01.*target_period is 200"):
        DQNSettings(target_period=200, target_polyak=0.01)


def test_failing_window_must_fit_into_the_buffer() -> None:
    with pytest.raises(SettingsError, match="failing_window is 9.*buffer_size, which is 8"):
        DQNSettings(buffer_size=8, failing_window=9)


def test_numpys_numbers_are_taken_over_as_pythons() -> None:
    given: dict[str, Any] = {
        "hidden": np.array([32, 16]),
        "members": np.int64(2),
        "discount": np.float64(0.5),
        "layer_norm": np.True_,
    }
    settings = DQNSettings(**given)
    assert settings == DQNSettings(hidden=(32, 16), members=2, discount=0.5, layer_norm=True)
    json.dumps(dataclasses.asdict(settings))


def test_settings_survive_json() -> None:
    settings = DQNSettings(hidden=(32,), target_period=None, target_polyak=0.005)
    assert DQNSettings(**json.loads(json.dumps(dataclasses.asdict(settings)))) == settings


def test_settings_of_the_paper_in_the_docstring_are_valid() -> None:
    settings = DQNSettings(
        learning_rate=0.001,
        discount=0.9,
        target_period=None,
        target_polyak=None,
        double=False,
        n_step=1,
        clip_targets=False,
        loss="mse",
        gradient_clip=None,
        epsilon_start=0.3,
        epsilon_end=0.3,
        protected_share=0.0,
    )
    assert not settings.has_target
