"""`serp diagnose`: what a run says of its domain file, in the words of the file."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from serp._util.number_format import readable
from serp._util.text import plural
from serp.cli.failures import say
from serp.cli.output import ExampledCommand, open_console, print_json, print_table

if TYPE_CHECKING:
    from rich.console import Console

    from serp.diagnosis.diagnosis import Diagnosis, FitRow
    from serp.sysid.monitor import MonitorRow, Side

_ROWS = 10  # of each table, without --all
_NAMED = 6  # fluents of a state that is shown


@click.command(
    "diagnose",
    cls=ExampledCommand,
    examples=[
        "serp diagnose runs/seven",
        "serp diagnose runs/seven --all --svg diagnosis.svg",
        "serp diagnose runs/seven --json > diagnosis.json",
    ],
)
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--all", "everything", is_flag=True,
              help="List what hardly matters, too.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
@click.option("--csv", "table", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE.csv",
              help="Write the numbers there, a row for each ground action and "
                   "fluent.")  # fmt: skip
@click.option("--png", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE.png",
              help="Draw predicted against observed there.")  # fmt: skip
@click.option("--svg", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE.svg",
              help="The same as SVG.")  # fmt: skip
@click.pass_context
def command(
    ctx: click.Context,
    run: Path,
    everything: bool,
    as_json: bool,
    table: Path | None,
    png: Path | None,
    svg: Path | None,
) -> None:
    """Say what is wrong or missing in the domain file of RUN, a folder of plan-and-learn.

    What the file predicts is compared with what was observed in the run's newest steps (up to
    20,000): fluents, rewards and ends. What costs most comes first, and what is not explained is
    listed. The environment is not needed, and nothing is changed.
    """
    for option, file, suffix in (("--csv", table, ".csv"), ("--png", png, ".png"),
                                 ("--svg", svg, ".svg")):  # fmt: skip
        if file is not None and file.suffix.lower() != suffix:
            raise click.BadParameter(f"name a file that ends in {suffix}", ctx, param_hint=option)
    if png is not None or svg is not None:
        from serp._util.extras import needs_extra

        with needs_extra("plots", "a picture of a diagnosis"):
            from serp.diagnosis.plots import picture

    from serp._util.files import write_durably
    from serp.diagnosis import export
    from serp.diagnosis.diagnosis import diagnose

    diagnosis = diagnose(run)
    if diagnosis.recorded.notice is not None:
        say(diagnosis.recorded.notice)
    if as_json:
        print_json(export.as_dict(diagnosis))
    else:
        print_diagnosis(open_console(), diagnosis, everything=everything)
    if table is not None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(export.table(diagnosis))
        write_durably(table, text.getvalue())
        say(f"The numbers are in {table}")
    if png is not None:
        write_durably(png, picture(diagnosis, "png"))
        say(f"Predicted against observed is drawn in {png}")
    if svg is not None:
        write_durably(svg, picture(diagnosis, "svg"))
        say(f"Predicted against observed is drawn in {svg}")


def print_diagnosis(console: Console, diagnosis: Diagnosis, *, everything: bool = False) -> None:
    """Print a diagnosis for people.

    Args:
        console: Where to.
        diagnosis: What is printed.
        everything: List what hardly matters, too.
    """
    from serp._util.number_format import percent

    for line in _head(diagnosis):
        console.print(line)
    told = [*diagnosis.matter, *(diagnosis.others if everything else ())]
    if told:
        console.print("")
        rows = [(percent(diagnosis.share(remark), 2), remark.text) for remark in told]
        print_table(console, ("of its error", "what the file says, and what was observed"), rows,
                    right=[0])  # fmt: skip
    if diagnosis.others and not everything:
        rest = plural(len(diagnosis.others), "finding that hardly matters",
                      "findings that hardly matter")  # fmt: skip
        console.print(f"{rest}: --all lists them")
    if diagnosis.unexplained:
        console.print("\nNot explained:")
        for sentence in diagnosis.unexplained:
            console.print(f"* {sentence}")
    wrong = [row for row in diagnosis.fits if row.cost > 0.0]
    _table(console, "Predicted one step ahead", _FIT_HEAD, list(_fit_rows(wrong)), everything,
           range(2, 7))  # fmt: skip
    missed = [row for row in diagnosis.observed if not row.numeric and _missed(row.written)]
    _table(console, "Predicates and ends, over the whole run", _PREDICATE_HEAD,
           list(_predicate_rows(missed)), everything, range(2, 7))  # fmt: skip
    _table(console, "Predicted worst, over the whole run", _WORST_HEAD,
           list(_worst_rows(diagnosis)), everything, (2, 3))  # fmt: skip


def _head(diagnosis: Diagnosis) -> Iterator[str]:
    recorded, sample = diagnosis.recorded, diagnosis.sample
    file = next(iter(recorded.files.values()), recorded.domain.name)
    yield (
        f"{recorded.run}: {file} beside the last {plural(len(recorded.experience), 'step')} of "
        + (f"{recorded.env_steps:,}")
    )
    if sample.left_out:
        reasons = ", ".join(f"{count:,} {reason}" for reason, count in sample.left_out.items())
        yield f"{plural(sample.skipped, 'step')} left out because of: {reasons}"
    if recorded.learned_from == "environment":
        yield "Rewards are compared with those of the environment, from which the learner learns."
    yield diagnosis.verdict


_FIT_HEAD = ("after", "fluent", "steps", "change", "error", "with findings", "range")


def _fit_rows(fits: Sequence[FitRow]) -> Iterator[tuple[str, ...]]:
    for row in fits:
        numbers = row.change, row.rmse_written, row.rmse_found, row.scale
        yield row.action, row.fluent, f"{row.steps:,}", *(readable(value, 3) for value in numbers)


_PREDICATE_HEAD = ("after", "predicate", "steps", "predicted changes", "happened", "unpredicted",
                   "wrong if adapted")  # fmt: skip


def _missed(side: Side) -> int:
    """Return in how many steps a change came or was predicted, but not both."""
    return side.predicted - side.happened + side.unpredicted


def _predicate_rows(rows: Sequence[MonitorRow]) -> Iterator[tuple[str, ...]]:
    for row in sorted(rows, key=lambda row: -_missed(row.written)):
        side = row.written
        counts = row.samples, side.predicted, side.happened, side.unpredicted
        numbers = (*counts, _missed(row.adapted))
        yield row.action, row.fluent, *(f"{count:,}" for count in numbers)


_WORST_HEAD = ("after", "fluent", "predicted", "observed", "in the state")


def _worst_rows(diagnosis: Diagnosis) -> Iterator[tuple[str, ...]]:
    """Yield the worst step of each pair of action and fluent, most of the range first."""
    model = diagnosis.recorded.model

    cases = [(row, row.worst) for row in diagnosis.observed if row.worst is not None]
    for row, case in sorted(cases, key=lambda pair: -pair[1].error / (pair[0].scale or 1.0)):
        state = ""
        if case.state is not None:
            values = list(model.values(case.state).items())
            shown = [
                f"{name}={str(value).lower() if isinstance(value, bool) else readable(value, 3)}"
                for name, value in values[:_NAMED]
            ]
            state = ", ".join(shown) + (", …" if len(values) > _NAMED else "")
        yield row.action, row.fluent, readable(case.written), readable(case.observed), state


def _table(
    console: Console,
    title: str,
    head: Sequence[str],
    rows: Sequence[Sequence[str]],
    everything: bool,
    right: Sequence[int],
) -> None:
    if not rows:
        return
    shown = rows if everything else rows[:_ROWS]
    console.print(f"\n{title}:")
    print_table(console, head, shown, right=right)
    if len(shown) < len(rows):
        console.print(f"and {len(rows) - len(shown)} more: --all lists them")
