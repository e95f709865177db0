"""How many decisions a second the soccer environments make, resets included; on one core.

    python tests/benchmarks/bench_soccer.py [--decisions N] [--rounds N]

Actions are drawn at random. Both take turns in short rounds, so that a busy machine slows both
alike; medians and best rounds are printed. Wanted: 8,000. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import random
import statistics
import time

from serp_envs.soccer import CornerKickDefender, SoccerDefender
from serp_envs.soccer.environment import SoccerEnv


def rate(env: SoccerEnv, decisions: int, rng: random.Random) -> float:
    """Play on; return decisions a second."""
    actions = rng.choices(range(len(env.scenario.actions)), k=decisions)
    start = time.perf_counter()
    for action in actions:
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()
    return decisions / (time.perf_counter() - start)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--decisions", type=int, default=4000, help="a round")
    parser.add_argument("--rounds", type=int, default=9)
    options = parser.parse_args()
    envs: dict[str, SoccerEnv] = {"soccer": SoccerDefender(), "corner-kick": CornerKickDefender()}
    rates: dict[str, list[float]] = {name: [] for name in envs}
    rng = random.Random(0)
    for env in envs.values():
        env.reset(seed=0)
    for _ in range(options.rounds):
        for name, env in envs.items():
            rates[name].append(rate(env, options.decisions, rng))
    for name, found in rates.items():
        print(f"  {name:<14}{statistics.median(found):>10,.0f} /s{max(found):>10,.0f} /s")


if __name__ == "__main__":
    main()
