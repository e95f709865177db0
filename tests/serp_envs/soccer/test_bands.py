"""The acceptance bands of the task: how dangerous the attacker is, and to whom."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import atan2
from typing import Any

import numpy as np
import pytest

from serp_envs.soccer import SoccerDefender, actions
from serp_envs.soccer.geometry import wrap

CONTESTS = 500
SEED = 1

Policy = Callable[[Mapping[str, Any]], int]


@dataclass(frozen=True)
class Band:
    """Percent, percent, mean return, decisions a contest."""

    goals: tuple[float, float]
    secured: tuple[float, float]
    mean_return: tuple[float, float]
    decisions: tuple[float, float]


def play(policy: Policy) -> tuple[Counter[str], float, float, int]:
    env = SoccerDefender()
    outcomes: Counter[str] = Counter()
    total, decisions, hits = 0.0, 0, 0
    _, info = env.reset(seed=SEED)
    for contest in range(CONTESTS):
        if contest:
            _, info = env.reset()
        ended = False
        while not ended:
            _, reward, terminated, truncated, info = env.step(policy(info))
            total += reward
            decisions += 1
            ended = terminated or truncated
        outcomes[info["outcome"]] += 1
        hits += info["damaging_hits"]
    return outcomes, total / CONTESTS, decisions / CONTESTS, hits


def random_policy() -> Policy:
    rng = np.random.default_rng(SEED)
    return lambda info: int(rng.integers(5))


def free_side(info: Mapping[str, Any]) -> int:
    """Push to the side on which the attacker is not."""
    x, y = info["ball_x"], info["ball_y"]
    mine = atan2(y - info["defender_y"], x - info["defender_x"])
    its = atan2(info["attacker_y"] - y, info["attacker_x"] - x)
    return 1 if wrap(wrap(its - mine)) <= 0.0 else 2


def always(action: int) -> Callable[[], Policy]:
    return lambda: lambda info: action


# The width of a band: sampling (500 contests: about 4 points of a share, 0.6 of a return, both at
# two standard errors) and the freedom that a description of a policy in words leaves.
SIDE = Band((20, 36), (30, 46), (-2.2, 0.6), (23, 30))
BANDS: dict[str, tuple[Callable[[], Policy], Band]] = {
    "random": (random_policy, Band((18, 30), (12, 26), (-2.6, -0.9), (21, 27))),
    "cover-goal": (always(0), Band((30, 42), (0, 1), (-5.6, -4.0), (32, 42))),
    "side-advance left": (always(1), SIDE),
    "side-advance right": (always(2), SIDE),
    "frontal-contrast": (always(3), Band((20, 45), (0, 5), (-7.0, -3.0), (30, 48))),
    "charge-opponent": (always(4), Band((12, 21), (0, 4), (-3.0, -1.6), (16, 22))),
    "free side": (lambda: free_side, Band((8, 20), (50, 71), (3.0, 4.9), (12, 18))),
}


def assert_in(band: Band, policy: Policy) -> tuple[Counter[str], int]:
    outcomes, mean_return, decisions, hits = play(policy)
    seen = {
        "goals": 100 * outcomes["goal"] / CONTESTS,
        "secured": 100 * outcomes["secured"] / CONTESTS,
        "mean_return": mean_return,
        "decisions": decisions,
    }
    missed = {
        name: (value, getattr(band, name))
        for name, value in seen.items()
        if not getattr(band, name)[0] <= value <= getattr(band, name)[1]
    }
    assert not missed, f"{missed} of {seen}"
    return outcomes, hits


@pytest.mark.parametrize("name", BANDS)
def test_a_simple_policy_ends_in_its_band(name: str) -> None:
    policy, band = BANDS[name]
    _, hits = assert_in(band, policy())
    assert (hits > 0) == (name in ("random", "charge-opponent"))


def test_without_a_defender_the_attacker_scores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(actions, "cover_goal", lambda world, robot: robot.stop())
    assert_in(Band((60, 75), (0, 0), (-9.6, -8.0), (8, 13)), lambda info: 0)
