"""`serp compare`: several algorithms on one task, under one protocol."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import click

from serp.ui.asked import asked_task
from serp.ui.options import again, trials_options
from serp.ui.output import examples, open_console, print_next, print_result, print_table
from serp.ui.root import say, stopped_by

if TYPE_CHECKING:
    from serp.runs.comparison.compare import Comparison


@click.command(
    "compare",
    epilog=examples(
        "serp compare --domain soccer --algorithms serp,mrp,dqn,ppo --seeds 5",
        "serp compare --domain cartpole --algorithms dqn,serp,serp@cartpole-reversed",
        "serp compare --domain cartpole --algorithms 'serp,serp:learner.members=1'",
        "serp compare --domain soccer --out runs/soccer --seeds 100 --engine ray --address auto",
    ),
)
@click.option("--algorithms", multiple=True, metavar="NAME,...",
              help="What is compared, the first with all others. NAME:SECTION.NAME=VALUE is one "
                   "with a setting changed, NAME@FILE one with another domain file. May be "
                   "repeated.  "
                   "[default: serp,mrp,dqn]")  # fmt: skip
@click.option("--threshold", type=float, metavar="X",
              help="Return from which a policy counts as good.")  # fmt: skip
@click.option("--evaluate-every", type=click.IntRange(min=1), metavar="N",
              help="Evaluate the learner alone every N env steps.  "
                   "[default: budget/10]")  # fmt: skip
@click.option("--evaluation-episodes", type=click.IntRange(min=1), metavar="N",
              help="Episodes of each such evaluation.  [default: 10]")  # fmt: skip
@click.option("--final-episodes", type=click.IntRange(min=1), metavar="N",
              help="Episodes of each evaluation at the end.  [default: 50]")  # fmt: skip
@trials_options(seeds=range(5), folder="compare")
def command(domain: str | None, algorithms: tuple[str, ...], **options: Any) -> int | None:
    """Train several algorithms on one task, with the same budget, seeds, reward and observation.

    The report says how fast each learns, what it costs and what is left to chance. --set changes
    all of serp's algorithms that do not set the same themselves. Each trial is a
    run folder. With the same --out only what is missing is run: more algorithms or seeds, or the
    rest of what Ctrl-C, SIGTERM or SIGHUP stopped (exit status 130, 143, 129).
    """
    task = asked_task(domain)
    from serp.errors import Interrupted
    from serp.runs.comparison.compare import compare

    try:
        comparison = compare(task, algorithms=_named(algorithms), **options)
    except Interrupted as stop:
        missing = " and --out of that folder." if options["out"] is None else "."
        say(f"{stop}.\nGo on with the same command{missing}")
        return stopped_by(stop)
    if options["quiet"]:
        print_result(comparison.path)
    else:
        _print_results(comparison, domain)
    return None


def _named(texts: tuple[str, ...]) -> list[str]:
    """Return the names that an option was given, apart by commas or given one by one."""
    parts = (part for text in texts for part in re.split(r",(?![^\[(]*[\])])", text))
    return [part.strip() for part in parts if part.strip()]


def _print_results(comparison: Comparison, domain: str | None) -> None:
    console, path = open_console(), comparison.path
    more = again("compare", "--out", str(path), "--seeds", "10", domain=domain)
    console.print("")
    print_table(console, *comparison.overview())
    if comparison.results.caution is not None:
        console.print(f"\n{comparison.results.caution}")
    print_next(
        console,
        (str(path / "report.html"), "the whole comparison on one page"),
        (str(path / "measures.csv"), "all measures, a row a trial"),
        (str(path / "trials"), "a run folder a trial, for serp why, report and evaluate"),
        (more, "more seeds; what is there is kept"),
    )
