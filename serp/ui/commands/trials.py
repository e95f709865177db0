"""Commands that run many trainings: `compare` and `tune`."""

from __future__ import annotations

import functools
import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from serp._util.text import measured, readable
from serp.ui.options import (
    Decorator,
    again,
    asked_task,
    command,
    domain_option,
    own_task_name,
    own_task_option,
    seed_option,
    settings_option,
)
from serp.ui.output import print_next, print_result, print_table, show

if TYPE_CHECKING:
    from serp.runs.comparison.compare import Comparison
    from serp.runs.tuning import Tuned


def _trials_options(seeds: range, folder: str) -> Decorator:
    """Return a decorator that gives a command the options of whatever runs trials.

    `folder` is the first part of the name of the default folder.
    """
    options = (
        domain_option,
        own_task_option,
        click.option("--seeds", metavar="N|A-B|A,B",
                     callback=lambda ctx, parameter, value: _parse_seeds(value),
                     help=f"Number of seeds, from {seeds.start} on, or the seeds themselves.  "
                          f"[default: {len(seeds)}]"),
        click.option("--env-steps", type=click.IntRange(min=1), metavar="N",
                     help="Budget of each training run."),
        settings_option,
        click.option("--out", type=click.Path(path_type=Path), metavar="DIR",
                     help="Folder of the results; existing results are continued.  "
                          f"[default: runs/{folder}-<domain>-<time>]"),
        click.option("--jobs", type=click.IntRange(min=1), metavar="N",
                     help="Number of parallel training runs.  [default: one per core]"),
        click.option("--engine", metavar="local|ray", default="local", show_default=True,
                     help="What runs the trials: processes on this machine, or a cluster."),
        click.option("--address", metavar="ADDRESS",
                     help="Address of the engine's cluster.  [default: workers on this machine]"),
        click.option("--quiet", is_flag=True, help="Print only the result."),
    )  # fmt: skip
    return lambda command: functools.reduce(lambda f, option: option(f), options[::-1], command)


def _parse_seeds(text: str | None) -> int | list[int] | None:
    """Return how many seeds, or the seeds themselves, of `--seeds`; None where it is not given."""
    if text is None or text.strip().isdecimal():
        return None if text is None else int(text)
    seeds: list[int] = []
    for part in text.split(","):
        ends = re.fullmatch(r"\s*(\d+)(?:-(\d+))?\s*", part)
        chosen = range(int(ends[1]), int(ends[2] or ends[1]) + 1) if ends else ()
        if not 0 < len(chosen) <= 10_000:
            raise click.BadParameter(
                "expected a number, or seeds such as 0-9 or 1,3", param_hint="--seeds"
            )
        seeds += chosen
    return seeds


@command(
    "serp compare --domain soccer --algorithms serp,mrp,dqn,ppo --seeds 5",
    "serp compare --domain cartpole --algorithms dqn,serp,serp@cartpole-reversed",
    "serp compare --domain cartpole --algorithms 'serp,serp:learner.members=1'",
    "serp compare --domain cartpole --baseline controllers.py:lean",
    "serp compare --domain soccer --out runs/soccer --seeds 100 --engine ray --address auto",
)
@click.option("--algorithms", multiple=True, metavar="NAME,...",
              help="Algorithms to compare; the first is the reference. NAME:SECTION.NAME=VALUE "
                   "changes a setting, NAME@FILE uses another domain file. May be repeated.  "
                   "[default: serp,mrp,dqn]")  # fmt: skip
@click.option("--baseline", metavar="FILE.py:FUNCTION",
              help="Also compare your own controller: a function that takes the values of the "
                   "fluents and returns the name of an action.")  # fmt: skip
@click.option("--threshold", type=float, metavar="X",
              help="Return at which a policy counts as good.")  # fmt: skip
@click.option("--evaluate-every", type=click.IntRange(min=1), metavar="N",
              help="Evaluate the learner alone every N env steps.  "
                   "[default: budget/10]")  # fmt: skip
@click.option("--evaluation-episodes", type=click.IntRange(min=1), metavar="N",
              help="Episodes in each evaluation of the learner alone.  [default: 10]")  # fmt: skip
@click.option("--final-episodes", type=click.IntRange(min=1), metavar="N",
              help="Episodes in each evaluation at the end.  [default: 50]")  # fmt: skip
@_trials_options(seeds=range(5), folder="compare")
def compare(domain: str | None, algorithms: tuple[str, ...], **options: Any) -> None:
    """Compare algorithms on one task, with the same budget and seeds.

    --set changes all of serp's algorithms, unless an algorithm sets that setting itself. Each trial
    is a run folder. Ctrl-C, SIGTERM or SIGHUP stops (exit status 130, 143, 129). If you repeat the
    command with the same --out, stopped trials continue, and missing trials run.
    """
    from serp.runs.comparison import compare as comparing

    named = domain is not None or own_task_name() is not None or options["out"] is None
    task = asked_task(domain) if named else None
    comparison = comparing.compare(task, algorithms=_named(algorithms), **options)
    if options["quiet"]:
        print_result(comparison.path)
    else:
        _print_comparison(comparison, domain)


def _named(texts: tuple[str, ...]) -> list[str]:
    """Return the names that an option was given, apart by commas or given one by one."""
    parts = (part for text in texts for part in re.split(r",(?![^\[(]*[\])])", text))
    return [part.strip() for part in parts if part.strip()]


def _print_comparison(comparison: Comparison, domain: str | None) -> None:
    path = comparison.path
    seeds = str(max(10, 2 * len(comparison.results.plan.seeds)))
    more = again("compare", "--out", str(path), "--seeds", seeds, domain=domain)
    show()
    print_table(*comparison.overview())
    show()
    for line in (*comparison.results.rewards, *comparison.results.verdicts):
        show(line)
    print_next(
        (str(path / "report.html"), "the whole comparison on one page"),
        (str(path / "measures.csv"), "all measures, one row per trial; overview.tex is for LaTeX"),
        (str(path / "figures" / "training.png"), "the training returns as a picture"),
        (str(path / "trials"), "one run folder per trial, for serp why, report and evaluate"),
        (more, "add more seeds; finished trials are kept"),
    )


@command(
    "serp tune --domain cartpole --vary learner.learning_rate=log:1e-4..1e-2",
    "serp tune --domain soccer --vary 'learner.hidden=[64,64],[128,128]' --out runs/tuned",
)
@click.option("--vary", multiple=True, required=True, metavar="SECTION.NAME=VALUES",
              help="A setting with a range (2..7, log:1e-4..1e-2) or with values (true,false). "
                   "May be repeated.")  # fmt: skip
@click.option("--algorithm", metavar="NAME", default="serp", show_default=True,
              help="One of serp's algorithms.")  # fmt: skip
@click.option("--objective", type=click.Choice(["training", "evaluation"]), default="training",
              show_default=True,
              help="What is maximised: the area under the training curve, or the return of the "
                   "trained policy.")  # fmt: skip
@click.option("--trials", type=click.IntRange(min=1), metavar="N", default=50, show_default=True,
              help="Total number of trials.")  # fmt: skip
@seed_option("Seed of the search.")
@_trials_options(seeds=range(1_000, 1_003), folder="tune")
def tune(domain: str | None, vary: tuple[str, ...], quiet: bool, **options: Any) -> None:
    """Search for better settings with whole training runs.

    If you repeat the command with the same --out, the study continues. By default, the seeds differ
    from those of `serp compare`, so a comparison tests the settings on new seeds.
    """
    from serp.runs import tuning

    varied = {name: values for name, _, values in (text.partition("=") for text in vary)}
    if len(varied) < len(vary):
        raise click.UsageError("--vary: a setting is given twice")
    tuned = tuning.tune(asked_task(domain), vary=varied, quiet=quiet, **options)
    assignments = [
        f"{section}.{name}={_text(value)}"
        for section, values in tuned.settings.items()
        for name, value in values.items()
    ]
    if quiet:
        print_result(" ".join(assignments))
    else:
        _print_tuned(tuned, assignments, options["algorithm"], domain)


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, separators=(",", ":"))


def _print_tuned(tuned: Tuned, assignments: list[str], algorithm: str, domain: str | None) -> None:
    compared = f"{algorithm}:{';'.join(assignments)},{algorithm}"
    compare = again("compare", "--algorithms", compared, "--seeds", "10", domain=domain)
    show(f"\nThe best of {tuned.trials} trials reached {readable(tuned.value)}.")
    if tuned.gain is not None:
        gain, error = tuned.gain
        before = readable(tuned.before)
        show(f"The original settings reached {before}. The gain is {measured(gain, error)}.")
        if math.isnan(error):
            show("One seed does not show the noise; give more with --seeds.")
        elif gain <= 2 * error:
            show("The gain is within the noise of the seeds (two standard errors).")
    show()
    print_table(("", ""), [(text, "") for text in assignments])
    print_next(
        (compare, "compare these settings with the original ones, on other seeds"),
        (f"optuna-dashboard {tuned.path / 'study.log'}", "show the study in a browser"),
    )
