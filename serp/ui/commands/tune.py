"""`serp tune`: search settings by the returns of whole trainings."""

from __future__ import annotations

import json
import shlex
from typing import TYPE_CHECKING, Any

import click

from serp._util.text import readable
from serp.ui.asked import asked_task
from serp.ui.options import own_task_name, trials_options
from serp.ui.output import examples, open_console, print_next, print_result, print_table
from serp.ui.root import say, stopped_by

if TYPE_CHECKING:
    from serp.runs.tuning import Tuned


@click.command(
    "tune",
    epilog=examples(
        "serp tune --domain cartpole --vary learner.learning_rate=log:1e-4..1e-2",
        "serp tune --domain soccer --vary 'learner.hidden=[64,64],[128,128]' --out runs/tuned",
    ),
)
@click.option("--vary", multiple=True, required=True, metavar="SECTION.NAME=VALUES",
              help="A setting and its values: a range (2..7, log:1e-4..1e-2), or values "
                   "(true,false). May be repeated.")  # fmt: skip
@click.option("--algorithm", metavar="NAME", default="serp", show_default=True,
              help="One of serp's algorithms.")  # fmt: skip
@click.option("--objective", type=click.Choice(["training", "evaluation"]), default="training",
              show_default=True,
              help="Area under the training curve, or return of the trained "
                   "policy.")  # fmt: skip
@click.option("--trials", type=click.IntRange(min=1), metavar="N", default=50, show_default=True,
              help="Trials of the study in all.")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, metavar="N",
              help="Seed of the search.")  # fmt: skip
@trials_options(seeds=range(1_000, 1_003), folder="tune")
def command(
    domain: str | None,
    vary: tuple[str, ...],
    quiet: bool,
    **options: Any,
) -> int | None:
    """Search settings by the returns of whole trainings, with Optuna.

    With the same --out the study goes on. Its seeds are not those of `serp compare`, so that
    results are not those of the seeds that were tuned on.
    """
    task = asked_task(domain)
    if task is None:
        raise click.UsageError("give --domain (`serp list` names the tasks) or --task")
    varied = {name: values for name, _, values in (text.partition("=") for text in vary)}
    if len(varied) < len(vary):
        raise click.UsageError("--vary: a setting is given twice")
    from serp.errors import Interrupted
    from serp.runs.tuning import tune

    try:
        tuned = tune(task, vary=varied, quiet=quiet, **options)
    except Interrupted as stop:
        say(f"{stop}.\nGo on with the same command and --out.")
        return stopped_by(stop)
    assignments = [
        f"{section}.{name}={_text(value)}"
        for section, values in tuned.settings.items()
        for name, value in values.items()
    ]
    if quiet:
        print_result(" ".join(assignments))
    else:
        _print_results(tuned, assignments, options["algorithm"], domain)
    return None


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, separators=(",", ":"))


def _print_results(
    tuned: Tuned, assignments: list[str], algorithm: str, domain: str | None
) -> None:
    own = own_task_name()
    changed = f"{algorithm}:{';'.join(assignments)}"
    compare = ["serp", "compare", *(("--task", own) if own else ()),
               *(("--domain", domain) if domain else ()),
               "--algorithms", f"{changed},{algorithm}", "--seeds", "10"]  # fmt: skip
    before = "" if tuned.before is None else f" ({readable(tuned.before)} as they were)"
    console = open_console()
    console.print("")
    rows = [(text, "") for text in assignments]
    print_table(console, (f"best of {tuned.trials}: {readable(tuned.value)}{before}", ""), rows)
    print_next(
        console,
        (shlex.join(compare), "whether they are better, with other seeds"),
        (f"optuna-dashboard {tuned.path / 'study.log'}", "the study in a browser"),
    )
