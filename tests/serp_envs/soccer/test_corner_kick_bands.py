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


# Over 6,000 corners: return −11.3, −5.4, 4.1, 6.4; goals 95, 51, 15, 5 %. 500 corners scatter by
# 0.06, 0.35, 0.35, 0.25 and by 1, 2, 1.5, 1 % (standard errors); the bands are three of them wide.
BANDS: dict[str, tuple[Callable[[], Policy | None], dict[str, tuple[float, float]]]] = {
    "idle": (lambda: None, {"return": (-11.6, -11.0), "goal": (91, 98), "cleared": (0, 0)}),
    "random": (random_policy, {"return": (-6.5, -4.3), "goal": (45, 58)}),
    "clear": (lambda: lambda info: 4, {"return": (3.0, 5.2), "goal": (10, 20)}),
    "rule": (lambda: rule, {"return": (5.6, 7.2), "goal": (2, 8)}),
}


@pytest.mark.parametrize("name", BANDS)
def test_a_simple_policy_ends_in_its_band(
    name: str, within_band: Callable[..., dict[str, float]]
) -> None:
    policy, band = BANDS[name]
    within_band(CornerKickDefender(), policy(), band)
