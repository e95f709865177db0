"""`serp plan-and-learn`: train, or continue a training."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from serp._util.text import plural
from serp.ui.commands.trained import print_account
from serp.ui.options import (
    again,
    asked_task,
    command,
    domain_option,
    own_task_name,
    own_task_option,
    refuse_given,
    seed_option,
    setting_option,
    settings_option,
)
from serp.ui.output import print_next, print_result, show

if TYPE_CHECKING:
    from serp.runs.run import Run


@command(
    "serp plan-and-learn --domain cartpole",
    "serp plan-and-learn --domain cartpole --episodes 300 --seed 7 --out runs/seven",
    "serp plan-and-learn --task my_robot.py",
    "serp plan-and-learn --resume runs/seven --episodes 500",
)
@domain_option
@own_task_option
@click.option("--preset", metavar="default|paper", default="default", show_default=True,
              help="Settings to begin with.")  # fmt: skip
@click.option("--episodes", type=click.IntRange(min=1), metavar="N",
              help="Train until N episodes have ended.")  # fmt: skip
@click.option("--env-steps", type=click.IntRange(min=1), metavar="N",
              help="Train for N steps in the environment.")  # fmt: skip
@seed_option("Seed of everything random.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR",
              help="Folder of the run.  [default: runs/<domain>-<time>]")  # fmt: skip
@click.option("--resume", type=click.Path(path_type=Path), metavar="RUN",
              help="Continue this run.")  # fmt: skip
@setting_option("--adapt", "adaptation.mode", metavar="off|parameters|residual|full|rewards",
                what="What the model learns from its errors.  "
                     "[default: by the preset]")  # fmt: skip
@setting_option("--planner", "planner.name", metavar="NAME",
                what="The planner.  [default: by the preset]")  # fmt: skip
@setting_option("--num-envs", "training.num_envs", metavar="N",
                what="Step N environments at the same time.  [default: 1]")  # fmt: skip
@settings_option
@click.option("--quiet", is_flag=True, help="No display; print the run's folder alone.")
def plan_and_learn(
    domain: str | None, out: Path | None, resume: Path | None, quiet: bool, **options: Any
) -> None:
    """Train on a task, or continue a training.

    The planner acts from the first step and the learner takes over; what the domain file flags
    unsafe is refused whenever there is a choice.

    A run that Ctrl-C, SIGTERM or SIGHUP stops (exit status 130, 143, 129) has lost nothing: the
    episode is finished first. A second one stops at once, and the run goes on from its last
    checkpoint.
    """
    resuming = resume is not None
    if resuming:
        begun_with = ("out", "preset", "seed", "adapt", "planner", "num_envs", "settings")
        refuse_given(begun_with, "cannot change in a run that is resumed")
    named = domain or own_task_name() or not resuming
    task = asked_task(domain) if named else str(resume)
    from serp.runs import train

    try:
        run = train.plan_and_learn(task, out=resume or out, resume=resuming, quiet=quiet, **options)
    except BaseException as error:
        own = own_task_name()
        if own and hasattr(error, "__notes__"):  # they say how the run goes on
            add = f"--task {shlex.quote(own)}"
            error.add_note(f"and add {add} to the command, for this task is not installed")
        raise
    if quiet:
        print_result(run.path)
    else:
        _print_results(run)


def _print_results(run: Run) -> None:
    from serp.runs.results import lead, title

    summary, path = run.summary, str(run.path)
    show(f"\n{path}: {title(summary)}")
    show(f"{lead(summary)} {plural(summary['vetoes'], 'proposal')} refused.\n")
    print_account(summary, summary["sight"])
    print_next(
        (again("evaluate", path), "how good it is now, without exploration"),
        (again("plan", path), "what its planner sees, and why"),
        (again("why", path), "what happened in a step, and the lines behind it"),
        (again("report", path), "the whole run as one page for the browser"),
    )
