"""What the planner `pyperplan` costs beside pyperplan itself, and whether its plans reach the goal.

    python -m tests.benchmarks.bench_pyperplan [--planner pyperplan] [--rounds 1] [--failure 0.1]
        [--episodes 10] [--only WORD]

For each problem, by turns: seconds from the files to a plan by pyperplan alone (parsing, grounding,
search), and to the first decision of our planner. Both searches meet ties in orders of their own
(that of pyperplan alone differs from process to process), so the numbers of expanded states differ,
by several times; the second ratio is that of the times for one of them. Then
episodes in the world of the files, in which actions fail: how many reach the goal, in how many
steps, with how many searches. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
import warnings
from pathlib import Path
from time import perf_counter
from typing import Any

from pyperplan import planner as alone
from pyperplan.task import Task

from serp.model.domain import load_domain
from serp.planning.plan_follower import PlanFollower
from serp.settings import PlannerSettings
from serp.tasks.file_world import FileWorld
from serp.tasks.task import WorldOptions
from serp_adapters.pyperplan.planner import make
from tests.generated.classical import blocks, gripper, logistics

PROBLEMS = {
    "first": [gripper(2)],
    "blocks-10": [blocks(10, seed) for seed in range(30)],
    "blocks-13": [blocks(13, seed) for seed in range(8)],
    "gripper-22": [gripper(22)],
    "logistics-4-12": [logistics(4, 12, seed) for seed in range(4)],
}
"""Name → problems of one size; what is compiled when first called, is so for the first."""
MOST_STEPS = 2_000

expanded = [0]
"""States that the searches have expanded so far."""
_successors = Task.get_successor_states


def _count(task: Task, state: Any) -> Any:
    expanded[0] += 1
    return _successors(task, state)


def direct(domain: Path, problem: Path, search: str, heuristic: str) -> None:
    """Search with pyperplan alone."""
    task = alone._ground(alone._parse(str(domain), str(problem)))
    alone.SEARCHES[search](task, alone.HEURISTICS[heuristic](task))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--planner", default="pyperplan:gbf:hff")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--failure", type=float, default=0.1)
    parser.add_argument("--episodes", type=int, default=10)
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    Task.get_successor_states = _count
    settings = PlannerSettings(name=options.planner, max_nodes=100_000)
    _, search, heuristic = options.planner.split(":")
    folder = Path(tempfile.mkdtemp())
    domain, problem = folder / "domain.pddl", folder / "problem.pddl"
    for name, problems in PROBLEMS.items():
        if name != "first" and options.only not in name:
            continue
        theirs = ours = 0.0
        states, played = [0, 0], [0, 0, 0]
        for texts, _ in itertools.product(problems, range(options.rounds)):
            domain.write_text(texts.domain, encoding="utf-8")
            problem.write_text(texts.problem or "", encoding="utf-8")
            expanded[0], start = 0, perf_counter()
            direct(domain, problem, search, heuristic)
            theirs += perf_counter() - start
            states[0] += expanded[0]
            expanded[0], start = 0, perf_counter()
            loaded = load_domain(domain, problem)
            planner = make(loaded.model, settings)
            assert loaded.model.initial_state is not None
            planner.forecast(loaded.model.initial_state)
            ours += perf_counter() - start
            states[1] += expanded[0]
            each = play(
                FileWorld(loaded, WorldOptions(failure=options.failure)), planner, options.episodes
            )
            played = [a + b for a, b in zip(played, each, strict=True)]
        count = len(problems) * options.rounds
        print(
            f"{name:<15}{count:>3} problems{len(loaded.model.actions):>6} actions"
            f"  pyperplan {theirs:7.2f} s  ours {ours:7.2f} s  ratio {ours / theirs:5.2f}"
            f"  per state {ours / states[1] * states[0] / theirs:5.2f}"
            f"  reached {played[0]}/{count * options.episodes}"
            f"  steps {played[1] / max(1, count * options.episodes):6.1f}  searches {played[2]}",
            flush=True,
        )


def play(world: FileWorld, planner: PlanFollower, episodes: int) -> tuple[int, int, int]:
    """Return how many episodes reach the goal, their steps, and the searches for them."""
    reached, steps, searches = 0, 0, planner.searches - 1
    for seed in range(episodes):
        state, _ = world.reset(seed=seed)
        for _ in range(MOST_STEPS):
            state, _, terminated, _, _ = world.step(planner.forecast(state).choice)
            steps += 1
            if terminated:
                reached += 1
                break
    return reached, steps, planner.searches - searches


if __name__ == "__main__":
    main()
