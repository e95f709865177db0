"""How good simple policies are in the soccer scenarios: the table of docs/reference/soccer.md.

    python -m tests.benchmarks.study_soccer_bands --task soccer --episodes 2000 --seeds 1-3

A row a policy; all play with the same seeds. Won are balls secured or cleared; behind the mean
return stands its standard error.
"""

from __future__ import annotations

import argparse
from collections import Counter

import numpy as np

from serp.tasks.registry import load_task
from tests.serp_envs.soccer.test_bands import BANDS, play, policies


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--task", choices=tuple(BANDS), default="soccer")
    parser.add_argument("--episodes", type=int, default=2000, help="for each seed")
    parser.add_argument("--seeds", default="1-3", help="one, or first-last")
    arguments = parser.parse_args()
    first, _, last = arguments.seeds.partition("-")
    print("| policy | return | goals | won | unsafe |\n|---|---|---|---|---|")
    with load_task(arguments.task).bind() as task:
        for name in policies(task, 0):
            counts, returns = Counter[str](), []
            for seed in range(int(first), int(last or first) + 1):
                more, others = play(task, name, arguments.episodes, seed)
                counts += more
                returns += others
            n = len(returns)
            won = counts["secured"] + counts["cleared"]
            print(
                f"| {name} | {np.mean(returns):.2f} ± {np.std(returns) / n**0.5:.2f} "
                f"| {100 * counts['goal'] / n:.1f} % | {100 * won / n:.1f} % "
                f"| {counts['unsafe'] / n:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
