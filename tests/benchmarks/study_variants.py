"""What the planner alone is worth with one domain file or another.

    python tests/benchmarks/study_variants.py domains/cartpole*.pddl --episodes 200
    python tests/benchmarks/study_variants.py domains/soccer*.pddl --episodes 2000

A row a file: mean return ± its standard error with the lookahead of the preset `default` (cart-pole
and soccer: five edges of two control periods each), and with one control period an edge.
"""

from __future__ import annotations

import argparse

import numpy as np
import torch

from serp.settings import resolve
from serp.tasks.registry import find_task
from serp.training.agent import Agent
from serp.training.evaluation import evaluate


def worth(file: str, changes: dict[str, dict[str, int]], episodes: int, seed: int) -> str:
    """Mean return ± its standard error."""
    with find_task(file).bind() as task:
        settings = resolve("default", task.task.settings, changes)
        agent = Agent(task, settings, 0)
        returns = np.array(evaluate(agent, task, "planner", episodes=episodes, seed=seed).returns)
    return f"{returns.mean():.2f} ± {returns.std(ddof=1) / len(returns) ** 0.5:.2f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("files", nargs="+")
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=99)
    options = parser.parse_args()
    torch.set_num_threads(1)
    print("| domain file | preset `default` | one control period an edge |")
    print("|---|---|---|")
    for file in options.files:
        cells = [
            worth(file, changes, options.episodes, options.seed)
            for changes in ({}, {"planner": {"repeat": 1}})
        ]
        print(f"| `{file}` | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
