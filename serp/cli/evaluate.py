"""`serp evaluate`: measure a trained policy, without exploration or learning."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from serp.cli.examples import ExampledCommand
from serp.cli.output import number, open_console, plural, print_json, print_table
from serp.cli.policies import open_run, policy_of_run


@click.command(
    "evaluate",
    cls=ExampledCommand,
    short_help="Measure a trained policy.",
    examples=[
        "serp evaluate runs/seven",
        "serp evaluate runs/seven --policy planner --episodes 100",
        "serp evaluate runs/seven --policy learner --json > learner.json",
    ],
)
@policy_of_run
@click.option("--episodes", type=click.IntRange(min=1), default=20, show_default=True, metavar="N",
              help="Episodes to measure.")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, metavar="N",
              help="Seed of the environment.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print all numbers as JSON.")
def command(
    run: Path,
    policy: Literal["serp", "planner", "learner"],
    episodes: int,
    seed: int,
    as_json: bool,
) -> None:
    """Measure a policy of RUN, the folder that plan-and-learn made."""
    loaded = open_run(run)
    result = loaded.evaluate(policy, episodes=episodes, seed=seed).as_dict()
    if as_json:
        print_json({"run": str(run), "seed": seed, **result})
        return
    console = open_console()
    console.print(f"{run}, policy {policy}, {plural(episodes, 'episode')}, seed {seed}")
    steps = sum(result["lengths"])
    print_table(
        console,
        ("", ""),
        [
            ("return", f"{number(result['mean'])} ± {number(result['std'])} (mean ± std)"),
            ("", f"{number(result['min'])} to {number(result['max'])}, "
                 f"median {number(result['median'])}"),
            ("terminated", f"{result['terminated']} of {episodes} episodes"),
            ("unsafe", f"{plural(result['unsafe_executed'], 'action')} executed that the model "
                       f"predicted unsafe, in {plural(steps, 'step')}"),
            ("vetoes", f"{plural(result['vetoes'], 'proposal')} refused"),
        ],
    )  # fmt: skip
