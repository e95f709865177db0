"""Ordinary PDDL problems, replanned in the file's world: how many goals are reached, and how fast.

    python tests/benchmarks/study_pddl.py [FOLDER ...] [--planner far-sight] [--each 1]
        [--steps 3000] [--seconds 30] [--slips 0.1] [--seed 0] [--examples]

The problems are those of the folders, the first `--each` of every domain, the middle one with 0
(`domain.pddl` beside `task01.pddl` or beside its folder, `domain01.pddl` beside `task01.pddl`,
`d.pddl` beside `p.pddl`), and the examples of the installed unified-planning that have actions
without durations and a goal. The world is the model of the files, in which a share of the steps,
`--slips`, executes an action drawn from those that are applicable. At every step the planner
decides, until the goal is reached or a limit is met. Each problem has a process of its own; all
seconds are of CPU.
"""

from __future__ import annotations

import argparse
import multiprocessing
import re
import resource
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from serp.agent.registry import make_planner
from serp.errors import SerpError
from serp.model.domain import load_domain
from serp.model.flags import APPLICABLE
from serp.settings import PlannerSettings


class Result(NamedTuple):
    """How one problem went: seconds of loading, of the longest decision, of all; peak MB."""

    ending: str
    steps: int = 0
    actions: int = 0
    fluents: int = 0
    loading: float = 0.0
    longest: float = 0.0
    seconds: float = 0.0
    memory: float = 0.0


def problems_in(folder: Path, each: int) -> Iterator[tuple[str, Path, Path]]:
    """Yield name, domain file and problem file of the problems in a folder."""
    for place in sorted({file.parent for file in folder.rglob("*.pddl")}):
        files = {file.stem: file for file in sorted(place.glob("*.pddl"), key=_natural)}
        shared = place.parent / "domain.pddl"
        common = files.get("domain") or files.get("d") or (shared if shared.exists() else None)
        found = []
        for stem, file in files.items():
            domain = files.get("domain" + re.sub(r"\D", "", stem)) or common
            if domain is not None and not re.match(r"(domain|d$)", stem):
                found.append((f"{place.name}/{stem}", domain, file))
        yield from found[:each] if each else found[(len(found) - 1) // 2 :][:1]


def _natural(file: Path) -> list[tuple[str, int]]:
    """Return a key by which `p10` comes after `p9`."""
    return [(text, int(number or 0)) for text, number in re.findall(r"(\D*)(\d*)", file.stem)]


def written_examples(folder: Path) -> Iterator[tuple[str, Path, Path]]:
    """Write unified-planning's own examples to a folder, and yield them as above."""
    from unified_planning.io import PDDLWriter
    from unified_planning.model import InstantaneousAction
    from unified_planning.test.examples import get_example_problems

    warnings.simplefilter("ignore")

    for name, example in sorted(get_example_problems().items()):
        problem: Any = example.problem
        if type(problem).__name__ != "Problem" or not problem.goals or problem.timed_effects:
            continue
        if not all(type(action) is InstantaneousAction for action in problem.actions):
            continue
        domain, file = folder / f"{name}.pddl", folder / f"{name}-problem.pddl"
        try:
            writer = PDDLWriter(problem)
            writer.write_domain(str(domain))
            writer.write_problem(str(file))
        except Exception:  # of any kind: what the language cannot say
            continue
        yield f"up/{name}", domain, file


def play(
    domain: Path, problem: Path, planner: str, steps: int, limit: float, slips: float, seed: int,
    into: Any,
) -> None:  # fmt: skip
    """Solve one problem and send the result."""
    warnings.simplefilter("ignore")
    random = np.random.default_rng(seed)
    resource.setrlimit(resource.RLIMIT_CPU, (int(limit) + 10, int(limit) + 10))  # of one decision
    try:
        start = process_time()
        model = load_domain(domain, problem).model
        if model.ground.goal is None:
            into.send(Result("refused: no goal"))
            return
        decide = make_planner(model, PlannerSettings(name=planner))
        state = model.initial_state
        loading, longest, ending, taken = process_time() - start, 0.0, "steps", 0
        while taken < steps:
            before = process_time()
            if before - start > limit:
                ending = "time"
                break
            taken += 1
            forecast = decide.forecast(state)
            choice = forecast.choice
            longest = max(longest, process_time() - before)
            if choice < 0:
                ending = "stuck"
                break
            if random.random() < slips:
                choice = int(random.choice(np.flatnonzero(forecast.flags & APPLICABLE)))
            outcome = model.step(state, choice)
            state = outcome.state
            if outcome.terminal:
                ending = "goal" if model.at_goal(state) else "lost"
                break
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
        into.send(
            Result(
                ending, taken, len(model.actions), len(model.fluents), loading, longest,
                process_time() - start, memory,
            )
        )  # fmt: skip
    except SerpError as error:
        into.send(Result("refused: " + str(error).splitlines()[0][:90]))
    except MemoryError:
        into.send(Result("memory"))


def solve(arguments: tuple[Any, ...]) -> Result:
    """Run `play` in a process of its own."""
    out, into = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.Process(target=play, args=(*arguments, into))
    process.start()
    into.close()
    try:
        result: Result = out.recv()
    except EOFError:
        result = Result("failed")
    process.kill()
    process.join()
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--planner", default="far-sight")
    parser.add_argument("--each", type=int, default=1)
    parser.add_argument("--steps", type=int, default=3_000)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--slips", type=float, default=0.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--examples", action="store_true", help="those of unified-planning, too")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        problems = [
            found for place in options.folders for found in problems_in(place, options.each)
        ]
        if options.examples:
            problems += written_examples(Path(folder))
        reached = tried = 0
        for name, domain, problem in problems:
            result = solve(
                (domain, problem, options.planner, options.steps, options.seconds, options.slips,
                 options.seed)
            )  # fmt: skip
            if not result.ending.startswith("refused"):
                tried += 1
                reached += result.ending == "goal"
            print(
                f"{name:<44}{result.ending:<10}{result.steps:>5} steps{result.actions:>7} actions"
                f"{result.fluents:>6} fluents{result.loading:>7.2f} s{result.longest:>7.2f} s"
                f"{result.seconds:>7.2f} s{result.memory:>7.0f} MB",
                flush=True,
            )
    print(f"{reached} of {tried} goals reached")


if __name__ == "__main__":
    main()
