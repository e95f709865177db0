"""`serp report`: a run as one HTML file."""

from __future__ import annotations

from pathlib import Path

import click

from serp.ui.asked import asked_own_task
from serp.ui.options import OutputFile, own_task_option
from serp.ui.output import examples, open_console


@click.command(
    "report",
    epilog=examples(
        "serp report runs/seven",
        "serp report runs/seven -o seven.html --pictures 0",
        "serp report runs/seven --evaluation serp-seed0 -o evaluation.html",
    ),
)
@click.argument("run", type=click.Path(path_type=Path))
@own_task_option
@click.option("-o", "--out", type=OutputFile(".html"), metavar="FILE.html",
              help="The file.  [default: report.html in RUN]")  # fmt: skip
@click.option("--evaluation", metavar="NAME",
              help="Show the steps of this recorded evaluation.  [default: of the training]",
              )  # fmt: skip
@click.option("--steps", type=click.IntRange(min=1), default=30_000, show_default=True, metavar="N",
              help="Most steps in the file.")  # fmt: skip
@click.option("--pictures", type=click.IntRange(min=0), default=1_000, show_default=True,
              metavar="N", help="Most pictures of the scene; at most 6 MB.")  # fmt: skip
def command(run: Path, out: Path | None, evaluation: str | None, steps: int, pictures: int) -> None:
    """Write what happened in RUN as one HTML file, which needs nothing else.

    Curves and refusals; and every recorded step with its scene, its state, its alternatives and the
    lines of the file behind the executed and the refused action.
    """
    from serp.runs.run import load_run
    from serp.ui.report.report import write_report

    loaded = load_run(run, asked_own_task())
    path = out or run / "report.html"
    write_report(loaded, path, evaluation=evaluation, steps=steps, pictures=pictures)
    open_console().print(f"{path}: {path.stat().st_size / 1e6:.2f} MB")
