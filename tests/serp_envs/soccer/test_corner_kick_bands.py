"""How hard a corner is: standing still < acting at random < a rule < what there is to win."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import hypot
from typing import Any

import numpy as np
import pytest

from serp_envs.soccer import CornerKickDefender

Policy = Callable[[Mapping[str, Any]], int]


def random_policy() -> Policy:
    rng = np.random.default_rng(1)
    return lambda info: int(rng.integers(6))


def rule(info: Mapping[str, Any]) -> int:
    """Mark the attacker; once the ball rolls go to meet it; kick it away when it is there."""
    if not info["kicked"]:
        return 2
    x, y = info["defender_x"] - info["ball_x"], info["defender_y"] - info["ball_y"]
    return 4 if hypot(x, y) < 0.5 else 3


# Over 3,000 corners: return −11.4, −5.1, 3.1, 3.7, 6.3; goals 94, 49, 13, 14, 4 %.
BANDS: dict[str, tuple[Callable[[], Policy | None], dict[str, tuple[float, float]]]] = {
    "idle": (lambda: None, {"return": (-12.0, -10.7), "goal": (89, 98), "cleared": (0, 0)}),
    "random": (random_policy, {"return": (-6.1, -4.1), "goal": (43, 54)}),
    "clear": (lambda: lambda info: 4, {"return": (2.8, 4.8), "goal": (9, 19)}),
    "rule": (lambda: rule, {"return": (5.6, 7.1), "goal": (1, 7)}),
}


@pytest.mark.parametrize("name", BANDS)
def test_a_simple_policy_ends_in_its_band(
    name: str, within_band: Callable[..., dict[str, float]]
) -> None:
    policy, band = BANDS[name]
    within_band(CornerKickDefender(), policy(), band)
