"""How good simple policies and the planner alone are in the soccer scenarios.

    python tests/benchmarks/study_soccer_bands.py --task soccer --episodes 2000 --seeds 1-3
    python tests/benchmarks/study_soccer_bands.py --task corner-kick --episodes 2000 --seeds 1-3

A row a policy: standing still, random, every fixed action, a rule of one line, monitor-replanning
with the shipped domain file. Won are balls secured or cleared. Every policy plays with the same
seeds; behind the mean return stands its standard error.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Mapping
from math import atan2, hypot, pi
from typing import Any

import numpy as np

from serp.agent.arbiter import Arbiter
from serp.agent.registry import make_planner
from serp.settings import resolve
from serp.tasks.registry import load_task
from serp.tasks.task import BoundTask

Policy = Callable[[Any, Mapping[str, Any]], int]

STANDS = "stand still"


def to_the_free_side(raw: Any, info: Mapping[str, Any]) -> int:
    """Push to the side on which the attacker is not."""
    x, y = info["ball_x"], info["ball_y"]
    mine = atan2(y - info["defender_y"], x - info["defender_x"])
    its = atan2(info["attacker_y"] - y, info["attacker_x"] - x)
    return 1 if (its - mine + pi) % (2.0 * pi) <= pi else 2


def mark_meet_clear(raw: Any, info: Mapping[str, Any]) -> int:
    """Mark the attacker; once the ball rolls go to meet it; within 0.5 m of it kick it away."""
    if not info["kicked"]:
        return 2
    x, y = info["defender_x"] - info["ball_x"], info["defender_y"] - info["ball_y"]
    return 4 if hypot(x, y) < 0.5 else 3


RULES: dict[str, Policy] = {"soccer": to_the_free_side, "corner-kick": mark_meet_clear}


def policies(task: BoundTask, seed: int) -> dict[str, Policy]:
    """By name; `STANDS` is played by a robot that is down."""
    rng = np.random.default_rng(seed)
    words = task.env.unwrapped.scenario.actions  # type: ignore[attr-defined]
    chosen = resolve("default", task.task.settings)
    arbiter = Arbiter(make_planner(task.model, chosen.planner), task.actions, chosen.arbiter)

    def always(action: int) -> Policy:
        return lambda raw, info: action

    return {
        STANDS: always(0),
        "random": lambda raw, info: int(rng.integers(len(words))),
        **{f"always {word}": always(action) for action, word in enumerate(words)},
        "rule": RULES[task.task.name],
        "planner": lambda raw, info: arbiter.plan(task.ground(raw)).action,
    }


def play(task: BoundTask, name: str, episodes: int, seed: int) -> tuple[Counter[str], list[float]]:
    """Counts (outcomes, `decisions`, `unsafe`, `hits`) and returns."""
    policy = policies(task, seed)[name]
    counts, returns = Counter[str](), []
    raw, info = task.reset(seed=seed)
    for episode in range(episodes):
        if episode:
            raw, info = task.reset()
        if name == STANDS:
            scenario = task.env.unwrapped.scenario  # type: ignore[attr-defined]
            scenario.world.robots[0].down_until = 10**9
        total, ended = 0.0, False
        while not ended:
            raw, reward, terminated, truncated, info = task.step(policy(raw, info))
            total += float(reward)
            counts["decisions"] += 1
            ended = terminated or truncated
        returns.append(total)
        counts[info["outcome"]] += 1
        counts["unsafe"] += info["unsafe_choices"]
        counts["hits"] += info["damaging_hits"]
    return counts, returns


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--task", choices=tuple(RULES), default="soccer")
    parser.add_argument("--episodes", type=int, default=2000, help="for each seed")
    parser.add_argument("--seeds", default="1-3", help="one, or first-last")
    arguments = parser.parse_args()
    first, _, last = arguments.seeds.partition("-")
    seeds = range(int(first), int(last or first) + 1)
    print("| policy | return | goals | won | decisions | unsafe | hits |")
    print("|---|---|---|---|---|---|---|")
    with load_task(arguments.task).bind() as task:
        for name in policies(task, 0):
            counts, returns = Counter[str](), []
            for seed in seeds:
                more, others = play(task, name, arguments.episodes, seed)
                counts += more
                returns += others
            n = len(returns)
            won = counts["secured"] + counts["cleared"]
            print(
                f"| {name} | {np.mean(returns):.2f} ± {np.std(returns) / n**0.5:.2f} "
                f"| {100 * counts['goal'] / n:.1f} % | {100 * won / n:.1f} % "
                f"| {counts['decisions'] / n:.1f} | {counts['unsafe'] / n:.2f} "
                f"| {counts['hits'] / n:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
