"""`serp why`: one recorded step of a run, explained in the words of its domain file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from serp.ui.options import own_task_option
from serp.ui.output import examples, open_console, print_json

if TYPE_CHECKING:
    from rich.console import Console

    from serp.runs.run_model import RunModel
    from serp.runs.step_account import StepAccount


@click.command(
    "why",
    epilog=examples(
        "serp why runs/seven",
        "serp why runs/seven --step 1204",
        "serp why runs/seven --evaluation serp-seed0 --episode 3 --step 8 --json",
    ),
)
@click.argument("run", type=click.Path(path_type=Path))
@own_task_option
@click.option("--step", type=click.IntRange(min=0), metavar="N",
              help="The step: as in decisions.csv, from 0; with --episode that of the episode, "
                   "from 1.  [default: the most telling one]")  # fmt: skip
@click.option("--episode", type=click.IntRange(min=1), metavar="E", help="The episode, from 1.")
@click.option("--evaluation", metavar="NAME",
              help="A step of an evaluation, such as serp-seed0, instead of the training.",
              )  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
def command(
    run: Path,
    step: int | None,
    episode: int | None,
    evaluation: str | None,
    as_json: bool,
) -> None:
    """Explain a step of RUN, the folder that plan-and-learn made.

    Who acted and why; the state; every action with its value, risk and reward, and what of the
    domain file is behind them; what was predicted and what came; the next best action, and what
    would have had to differ for it. Without a step, the last refused proposal that was applicable
    is explained, else the last unsafe step, else the last refused proposal, else the last step.
    """
    from serp.runs.run_model import RunModel
    from serp.runs.step_account import account_of_step, most_telling

    if episode is not None and step is None:
        raise click.UsageError("give --step beside --episode")
    read, because = RunModel(run), ""
    recording = read.recording(evaluation)
    if step is None:
        step, because = most_telling(recording)
    elif episode is not None:
        step = recording.find(episode, step)
    account = account_of_step(read, recording, step, because)
    if as_json:
        about = {"run": str(run), "evaluation": evaluation, "domain": read.domain.name}
        print_json({**about, **account.as_dict()})
    else:
        _print(open_console(), read, account)


def _print(console: Console, run: RunModel, account: StepAccount) -> None:
    """Print an account in sentences and tables."""
    from serp.runs.step_account import heading, what_came, what_would_differ, who_acted
    from serp.ui.account import print_account

    because = f" ({account.because})" if account.because else ""
    console.print(f"{run.domain.name}, {heading(account)}{because}", style="bold")
    console.print(f"Lines are those of {run.domain.source.name}, the run's copy.", style="dim")
    for line in who_acted(account):
        console.print(line)
    console.print("")
    print_account(
        console, account.account, [], account.proposed if account.step.decision.vetoed else ""
    )
    if account.ahead_by:
        console.print(f"Later steps were planned again with {account.ahead_by}.")
    else:
        console.print("Later steps are unknown: today's model plans otherwise.")
    console.print("")
    for line in what_came(account):
        console.print(line)
    differences = what_would_differ(account)
    for line in ["", *differences] if differences else []:
        console.print(line)
