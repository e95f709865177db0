from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from serp.adaptation.settings import MODES, AdaptationSettings
from serp.errors import SettingsError
from serp.settings import Settings


@pytest.mark.parametrize(
    "wrong",
    [
        {"mode": "on"},
        {"mode": None},
        {"mode": True},
        {"nonlinear": 1},
        {"nonlinear": "yes"},
        {"tries": -1},
        {"tries": 1.5},
        {"tries": True},
        {"tries": "3"},
        {"tries": None},
        {"tries": float("inf")},
    ],
    ids=str,
)
def test_a_setting_out_of_range_is_refused_by_its_name(wrong: dict[str, Any]) -> None:
    with pytest.raises(SettingsError, match=f"correction: {next(iter(wrong))} must be"):
        AdaptationSettings(**wrong)
    with pytest.raises(SettingsError, match=next(iter(wrong))):
        Settings().replace({"correction": wrong})


@pytest.mark.parametrize("mode", MODES)
def test_what_a_mode_does(mode: Any) -> None:
    settings = AdaptationSettings(mode=mode)
    assert settings.residual == (mode in ("residual", "full"))
    assert settings.literals == (mode in ("literals", "full"))


def test_nothing_is_corrected_unless_asked_for() -> None:
    assert AdaptationSettings().mode == "off"
    assert AdaptationSettings().tries == 0


def test_numbers_of_numpy_are_taken() -> None:
    taken = AdaptationSettings(tries=np.int64(3)).tries  # type: ignore[arg-type]
    assert taken == 3 and type(taken) is int


def test_settings_survive_being_written_down() -> None:
    settings = Settings().replace({"correction": {"mode": "full", "tries": 5, "nonlinear": False}})
    assert Settings.from_dict(settings.as_dict()) == settings
