"""How good a policy is: episodes played to their ends, measured against a band."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import pytest

from serp_envs.soccer.environment import SoccerEnv

EPISODES = 500
SEED = 11

Policy = Callable[[Mapping[str, Any]], int]


def measure(env: SoccerEnv, policy: Policy | None, episodes: int = EPISODES) -> dict[str, float]:
    """Percent of each outcome, mean `return`, `decisions` and `hits` an episode; None stands still.

    500 episodes scatter by 2 points of a share and 0.3 of a return (standard errors).
    """
    outcomes: Counter[str] = Counter()
    total, decisions, hits = 0.0, 0, 0
    _, info = env.reset(seed=SEED)
    for episode in range(episodes):
        if episode:
            _, info = env.reset()
        ended = False
        while not ended:
            if policy is None:
                env.scenario.world.robots[0].down_until = 10**9
            _, reward, terminated, truncated, info = env.step(0 if policy is None else policy(info))
            total += reward
            decisions += 1
            ended = terminated or truncated
        outcomes[info["outcome"]] += 1
        hits += info["damaging_hits"]
    seen = {outcome: 100.0 * count / episodes for outcome, count in outcomes.items()}
    return {
        **seen,
        "return": total / episodes,
        "decisions": decisions / episodes,
        "hits": hits / episodes,
    }


def check(
    env: SoccerEnv,
    policy: Policy | None,
    band: Mapping[str, tuple[float, float]],
    episodes: int = EPISODES,
) -> dict[str, float]:
    """What `measure` says, which must lie in the band."""
    seen = measure(env, policy, episodes)
    missed = {
        name: (seen.get(name, 0.0), (low, high))
        for name, (low, high) in band.items()
        if not low <= seen.get(name, 0.0) <= high
    }
    assert not missed, f"{missed} of {seen}"
    return seen


@pytest.fixture
def within_band() -> Callable[..., dict[str, float]]:
    return check
