"""`serp diagnose`: what a run says of its domain file, in the words of the file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from serp._util.text import percent, plural, readable
from serp.ui.main import say
from serp.ui.options import OutputFile
from serp.ui.output import examples, open_console, print_json, print_table

if TYPE_CHECKING:
    from rich.console import Console

    from serp.runs.diagnosis.diagnosis import Diagnosis, FitRow, Worst


_ROWS = 10  # of each table, without --all
_NAMED = 6  # fluents of a state that is shown


@click.command(
    "diagnose",
    epilog=examples(
        "serp diagnose runs/seven",
        "serp diagnose runs/seven --all --svg diagnosis.svg",
        "serp diagnose runs/seven --json > diagnosis.json",
    ),
)
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--all", "everything", is_flag=True,
              help="List what hardly matters, too.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
@click.option("--png", type=OutputFile(".png"), metavar="FILE.png",
              help="Draw predicted against observed there.")  # fmt: skip
@click.option("--svg", type=OutputFile(".svg"), metavar="FILE.svg",
              help="The same as SVG.")  # fmt: skip
def command(run: Path, everything: bool, as_json: bool, png: Path | None, svg: Path | None) -> None:
    """Say what is wrong or missing in the domain file of RUN, a folder of plan-and-learn.

    What the file predicts is compared with what was observed in the run's newest steps (up to
    20,000): fluents, rewards and ends. What costs most comes first, and what is not explained is
    listed. The environment is not needed, and nothing is changed.
    """
    if png is not None or svg is not None:
        from serp.errors import needs_extra

        with needs_extra("plots", "a picture of a diagnosis"):
            from serp.runs.diagnosis.plots import picture

    from serp._util.files import write_durably
    from serp.runs.diagnosis import diagnosis as export
    from serp.runs.diagnosis.diagnosis import diagnose

    diagnosis = diagnose(run)
    if diagnosis.recorded.notice is not None:
        say(diagnosis.recorded.notice)
    if as_json:
        print_json(export.as_dict(diagnosis))
    else:
        print_diagnosis(open_console(), diagnosis, everything=everything)
    pictures: dict[Literal["png", "svg"], Path | None] = {"png": png, "svg": svg}
    for kind, file in pictures.items():
        if file is not None:
            write_durably(file, picture(diagnosis, kind))
            say(f"Predicted against observed is drawn in {file}")


def print_diagnosis(console: Console, diagnosis: Diagnosis, *, everything: bool = False) -> None:
    """Print a diagnosis for people; also what hardly matters, if everything is asked for."""
    recorded, sample = diagnosis.recorded, diagnosis.sample
    file = next(iter(recorded.files.values()), recorded.domain.name)
    newest = plural(len(recorded.experience), "step")
    console.print(f"{recorded.run}: {file} beside the last {newest} of {recorded.env_steps:,}")
    if sample.left_out:
        reasons = ", ".join(f"{count:,} {reason}" for reason, count in sample.left_out.items())
        console.print(f"{plural(sample.skipped, 'step')} left out because of: {reasons}")
    if recorded.learned_from == "environment":
        console.print(
            "Rewards are compared with those of the environment, from which the learner learns."
        )
    console.print(diagnosis.verdict)
    told = [*diagnosis.matter, *(diagnosis.others if everything else ())]
    if told:
        console.print("")
        rows = [(percent(diagnosis.share(remark)), remark.text) for remark in told]
        head = ("of its error", "what the file says, and what was observed")
        print_table(console, head, rows, right=[0])
    if diagnosis.others and not everything:
        rest = plural(len(diagnosis.others), "finding that hardly matters",
                      "findings that hardly matter")  # fmt: skip
        console.print(f"{rest}: --all lists them")
    if diagnosis.unexplained:
        console.print("\nNot explained:")
        for sentence in diagnosis.unexplained:
            console.print(f"* {sentence}")
    console.print(f"\nThe run planned with this model: {recorded.adoption}")
    for title, titles, rows_of, right in _TABLES:
        lines = list(rows_of(diagnosis))
        shown = lines if everything else lines[:_ROWS]
        if shown:
            console.print(f"\n{title}:")
            print_table(console, titles, shown, right=right)
        if len(shown) < len(lines):
            console.print(f"and {len(lines) - len(shown)} more: --all lists them")


def _fit_rows(diagnosis: Diagnosis) -> Iterator[tuple[str, ...]]:
    for row in diagnosis.fits:
        if row.cost > 0.0:
            numbers = row.change, row.rmse_written, row.rmse_found, row.scale
            texts = (readable(value) for value in numbers)
            yield row.action, row.fluent, f"{row.steps:,}", *texts


def _predicate_rows(diagnosis: Diagnosis) -> Iterator[tuple[str, ...]]:
    for row in sorted(diagnosis.fits, key=lambda row: -row.missed):
        if row.missed:
            counts = row.steps, row.predicted, row.happened, row.unpredicted
            yield row.action, row.fluent, *(f"{count:,}" for count in counts)


def _worst_rows(diagnosis: Diagnosis) -> Iterator[tuple[str, ...]]:
    """Yield the worst step of each pair of action and fluent, most of the range first."""
    cases = [(row, row.worst) for row in diagnosis.fits if row.worst is not None]

    def size(case: tuple[FitRow, Worst]) -> float:
        row, worst = case
        return abs(worst.observed - worst.predicted) / (row.scale or 1.0)

    for row, worst in sorted(cases, key=size, reverse=True):
        values = list(diagnosis.recorded.model.values(worst.state).items())
        shown = [
            f"{name}={str(value).lower() if isinstance(value, bool) else readable(value)}"
            for name, value in values[:_NAMED]
        ]
        state = ", ".join(shown) + (", …" if len(values) > _NAMED else "")
        yield row.action, row.fluent, readable(worst.predicted), readable(worst.observed), state


def _adoption_rows(diagnosis: Diagnosis) -> Iterator[tuple[str, ...]]:
    errors = {quantity.name: quantity.off for quantity in diagnosis.quantities}
    for fluent in diagnosis.recorded.adoption.fluents:
        error = percent(errors[fluent.fluent]) if fluent.fluent in errors else "–"
        yield fluent.fluent, error, "yes" if fluent.adapted else "no", fluent.why


_TABLES = (
    (
        "Adapted in the run",
        ("fluent", "error of the file, of the change", "adapted", "why"),
        _adoption_rows, [1],
    ),
    (
        "Predicted one step ahead",
        ("after", "fluent", "steps", "change", "error", "with findings", "range"),
        _fit_rows, range(2, 7),
    ),
    (
        "Predicates and ends",
        ("after", "predicate", "steps", "predicted changes", "happened", "unpredicted"),
        _predicate_rows, range(2, 6),
    ),
    (
        "Predicted worst",
        ("after", "fluent", "predicted", "observed", "in the state"),
        _worst_rows, range(2, 4),
    ),
)  # fmt: skip
"""Title, head, rows and right-aligned columns of each table."""
