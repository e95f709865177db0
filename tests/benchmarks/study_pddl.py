"""Ordinary PDDL problems, replanned in the file's world: how many goals are reached, and how fast.

    python tests/benchmarks/study_pddl.py [FOLDER ...] [--planner far-sight] [--each 1]
        [--steps 200] [--seconds 120] [--examples]

The problems are those of the folders, the first `--each` of every domain (`domain.pddl` beside
`task01.pddl`, `domain01.pddl` beside `task01.pddl`, `d.pddl` beside `p.pddl`, as pyperplan's and
unified-planning's `test/pddl` have them), and the examples of the installed unified-planning that
have actions without durations and a goal. The world is the model of the files. At every step the
planner decides, until the goal is reached or a limit is met. Each problem has a process of its own.
"""

from __future__ import annotations

import argparse
import multiprocessing
import re
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

from serp.agent.registry import make_planner
from serp.errors import SerpError
from serp.model.domain import load_domain
from serp.settings import PlannerSettings


class Result(NamedTuple):
    """How one problem went; seconds are those of loading, the first decision, and all others."""

    ending: str
    steps: int = 0
    actions: int = 0
    fluents: int = 0
    loading: float = 0.0
    first: float = 0.0
    others: float = 0.0


def problems_in(folder: Path, each: int) -> Iterator[tuple[str, Path, Path]]:
    """Yield name, domain file and problem file of the problems in a folder."""
    for place in sorted({file.parent for file in folder.rglob("*.pddl")}):
        files = {file.stem: file for file in sorted(place.glob("*.pddl"))}
        found = 0
        for stem, file in files.items():
            if re.match(r"(domain|d$)", stem):
                continue
            number = re.sub(r"\D", "", stem)
            domain = files.get(f"domain{number}") or files.get("domain") or files.get("d")
            if domain is not None and found < each:
                found += 1
                yield f"{place.name}/{stem}", domain, file


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


def play(domain: Path, problem: Path, planner: str, steps: int, into: Any) -> None:
    """Solve one problem and send the result."""
    warnings.simplefilter("ignore")
    try:
        start = perf_counter()
        model = load_domain(domain, problem).model
        if model.ground.goal is None:
            into.send(Result("refused: no goal"))
            return
        decide = make_planner(model, PlannerSettings(name=planner))
        state = model.initial_state
        loading, seconds, ending = perf_counter() - start, [], "lost"
        for _ in range(steps):
            before = perf_counter()
            choice = decide.forecast(state).choice
            seconds.append(perf_counter() - before)
            if choice < 0:
                ending = "stuck"
                break
            outcome = model.step(state, choice)
            state = outcome.state
            if outcome.terminal:
                ending = "goal"
                break
        into.send(
            Result(
                ending, len(seconds), len(model.actions), len(model.fluents), loading,
                seconds[0], sum(seconds[1:]),
            )
        )  # fmt: skip
    except SerpError as error:
        into.send(Result("refused: " + str(error).splitlines()[0][:90]))


def solve(arguments: tuple[Any, ...], limit: float) -> Result:
    """Run `play` in a process of its own."""
    out, into = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.Process(target=play, args=(*arguments, into))
    process.start()
    into.close()
    try:
        result: Result = out.recv() if out.poll(limit) else Result("time")
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
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=120.0)
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
            result = solve((domain, problem, options.planner, options.steps), options.seconds)
            loading, first, others = result[4:]
            if not result.ending.startswith("refused"):
                tried += 1
                reached += result.ending == "goal"
            print(
                f"{name:<44}{result.ending:<10}{result.steps:>4} steps{result.actions:>7} actions"
                f"{result.fluents:>6} fluents{loading:>8.2f} s{first:>8.2f} s{others:>8.2f} s",
                flush=True,
            )
    print(f"{reached} of {tried} goals reached")


if __name__ == "__main__":
    main()
