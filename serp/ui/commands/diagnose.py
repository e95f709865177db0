"""`serp diagnose`: what a run says of its domain file, in the words of the file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from serp._util.text import percent, plural, readable
from serp.ui.options import OutputFile, own_task_option
from serp.ui.output import examples, open_console, print_json, print_table
from serp.ui.root import say

if TYPE_CHECKING:
    from rich.console import Console

    from serp.model.learned.adoption import WorthAdoption
    from serp.runs.diagnosis.diagnosis import Diagnosis


@click.command(
    "diagnose",
    epilog=examples(
        "serp diagnose runs/seven",
        "serp diagnose runs/seven --svg diagnosis.svg",
        "serp diagnose runs/seven --json > diagnosis.json",
    ),
)
@click.argument("run", type=click.Path(path_type=Path))
@own_task_option
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
@click.option("--svg", type=OutputFile(".svg"), metavar="FILE.svg",
              help="Draw predicted against observed there.")  # fmt: skip
def command(run: Path, as_json: bool, svg: Path | None) -> None:
    """Report what is wrong or missing in the domain file of RUN, a folder of plan-and-learn.

    The predictions of the file are compared with the run's newest steps (up to 20,000): fluents,
    rewards and ends. The most costly findings come first. The environment is not needed, and
    nothing is changed.
    """
    if svg is not None:
        from serp.errors import needs_extra

        with needs_extra("plots", "a picture of a diagnosis"):
            from serp.runs.diagnosis.plots import picture

    from serp._util.files import write_durably
    from serp.runs.diagnosis.diagnosis import as_dict, diagnose

    diagnosis = diagnose(run)
    if as_json:
        print_json(as_dict(diagnosis))
    else:
        _print(open_console(), diagnosis)
    if svg is not None:
        write_durably(svg, picture(diagnosis, "svg"))
        say(f"Predicted against observed is drawn in {svg}")


def _print(console: Console, diagnosis: Diagnosis) -> None:
    recorded, sample = diagnosis.recorded, diagnosis.sample
    file = next(iter(recorded.files.values()), recorded.domain.name)
    newest = f"{len(recorded.experience):,} of {plural(recorded.env_steps, 'step')}"
    console.print(f"{recorded.run}: {file} compared with {newest}")
    if sample.left_out:
        reasons = ", ".join(f"{count:,} {reason}" for reason, count in sample.left_out.items())
        console.print(f"{plural(sample.skipped, 'step')} left out because of: {reasons}")
    if recorded.learned_from == "environment":
        console.print("Rewards are compared with those of the environment.")
    console.print(diagnosis.verdict)
    if diagnosis.remarks:
        console.print("")
        rows = [(percent(remark.share), remark.text) for remark in diagnosis.remarks]
        print_table(console, ("of its error", "finding"), rows, right=[0])
    quantities = sorted(diagnosis.quantities, key=lambda q: -q.error)
    if quantities:
        console.print("")
        head = ("fluent", "change in a step", "error of the file", "with findings", "mostly after")
        table = [
            (
                quantity.shown,
                readable(quantity.change) if quantity.numeric else f"{quantity.change:,.0f} times",
                percent(quantity.error),
                percent(quantity.error_left),
                quantity.action if quantity.squared else "",
            )
            for quantity in quantities
        ]
        print_table(console, head, table, right=range(1, 4))
    console.print(f"\nThe run planned with this model: {recorded.adoption}")
    _print_worth(console, recorded.adoption.worth)


def _print_worth(console: Console, worth: tuple[WorthAdoption, ...]) -> None:
    """Print how well reward and end were predicted before each step was learned from."""
    told = [each for each in worth if each.corrected]
    if not told:
        return
    head = ("in the newest steps", "by the file's rules", "corrected")
    rows = []
    for each in told:
        ends = each.name == "terminal"
        name = "end: Brier score" if ends else "reward: root mean square error"
        errors = each.written, each.in_use
        rows.append((name, *(readable(error if ends else error**0.5) for error in errors)))
    print_table(console, head, rows, right=[1, 2])
    rows = [
        (percent(of.chance), percent(of.ended), f"{of.steps:,}")
        for each in told
        for of in each.reliability
    ]
    if rows:
        print_table(console, ("chance of an end", "ended", "steps"), rows, right=range(3))
