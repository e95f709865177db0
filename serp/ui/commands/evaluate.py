"""`serp evaluate`: measure a trained policy, without exploration or learning."""

from __future__ import annotations

from pathlib import Path

import click

from serp._util.text import plural, readable
from serp.runs import Policy
from serp.ui.asked import open_run
from serp.ui.options import policy_of_run
from serp.ui.output import examples, open_console, print_json, print_table
from serp.ui.trained import print_account, unsafe_text


@click.command(
    "evaluate",
    epilog=examples(
        "serp evaluate runs/seven",
        "serp evaluate runs/seven --policy planner --episodes 500",
        "serp evaluate runs/seven --policy learner --json > learner.json",
    ),
)
@policy_of_run
@click.option("--episodes", type=click.IntRange(min=1), default=100, show_default=True, metavar="N",
              help="Episodes to measure.")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, metavar="N",
              help="Seed of the environment.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print all numbers as JSON.")
def command(run: Path, policy: Policy, episodes: int, seed: int, as_json: bool) -> None:
    """Measure a policy of RUN, the folder that plan-and-learn made.

    Return is the sum of the environment's rewards. The interval holds the mean of all episodes with
    95 % confidence (Student's t); the spread is what single episodes differ by.

    The steps are recorded in RUN, so that `serp why RUN --evaluation POLICY-seedN` explains them.
    """
    from serp.agent.agent import account_of

    loaded = open_run(run)
    result = loaded.evaluate(policy, episodes=episodes, seed=seed, record=True).as_dict()
    if as_json:
        print_json({"run": str(run), "seed": seed, **result, **account_of(loaded.agent)})
        return
    console = open_console()
    console.print(f"{run}, policy {policy}, {plural(episodes, 'episode')}, seed {seed}")
    console.print(f"Measured: {result['meaning']}.")
    steps = sum(result["lengths"])
    interval = ""
    if result["confidence_interval"] is not None:
        low, high = map(readable, result["confidence_interval"])
        interval = f", 95 % interval {low} to {high}"
    rows = [
        ("mean return", f"{readable(result['mean'])}{interval}"),
        ("spread", f"standard deviation {readable(result['std'])}, {readable(result['min'])} to "
                   f"{readable(result['max'])}, median {readable(result['median'])}"),
        ("terminated", f"{result['terminated']} of {episodes} episodes"),
        ("unsafe", f"{unsafe_text(result)}; {plural(steps, 'step')} in all"),
        ("vetoes", f"{plural(result['vetoes'], 'proposal')} refused"),
    ]  # fmt: skip
    print_table(console, ("", ""), rows)
    if result["warning"] is not None:
        console.print(result["warning"])
    console.print("")
    print_account(console, account_of(loaded.agent), result["sight"])
