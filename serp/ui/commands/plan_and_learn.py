"""`serp plan-and-learn`: train, or continue a training."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from serp._util.text import duration, percent, plural, sparkline
from serp.ui.commands.trained import print_account
from serp.ui.options import (
    again,
    asked_task,
    command,
    domain_option,
    own_task_name,
    own_task_option,
    recorded_task,
    refuse_given,
    seed_option,
    setting_option,
    settings_option,
)
from serp.ui.output import print_next, print_result, print_table, show

if TYPE_CHECKING:
    from serp.runs.run import Run
    from serp.tasks.task import Task


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
                     "[default: the preset's]")  # fmt: skip
@setting_option("--planner", "planner.name", metavar="NAME",
                what="The planner.  [default: the preset's]")  # fmt: skip
@setting_option("--num-envs", "training.num_envs", metavar="N",
                what="Step N environments at the same time.  [default: 1]")  # fmt: skip
@settings_option
@click.option("-v", "--verbose", is_flag=True,
              help="At the end, also show why this policy was selected, how far the planner saw, "
                   "and what the model learned.")  # fmt: skip
@click.option("--quiet", is_flag=True, help="Show no progress; print only the run's folder.")
def plan_and_learn(
    domain: str | None,
    out: Path | None,
    resume: Path | None,
    verbose: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Train on a task, or continue a run.

    The planner acts from the first step and the learner takes over; what the domain file flags
    unsafe is refused whenever there is a choice.

    Ctrl-C, SIGTERM or SIGHUP finishes the episode and saves before stopping (exit status 130, 143,
    129); nothing is lost. A second signal stops at once; a resumed run then continues from its last
    checkpoint.
    """
    resuming = resume is not None
    if resuming:
        begun_with = ("out", "preset", "seed", "adapt", "planner", "num_envs", "settings")
        refuse_given(begun_with, "cannot change in a resumed run")
    task: Task | str
    if resume is None or domain or own_task_name():
        task = asked_task(domain)
    else:
        task = recorded_task(resume) or str(resume)
    from serp.runs import train

    try:
        run = train.plan_and_learn(task, out=resume or out, resume=resuming, quiet=quiet, **options)
    except BaseException as error:
        own = own_task_name()
        of_module = own is not None and not own.partition(":")[0].endswith(".py")
        if own and of_module and hasattr(error, "__notes__"):  # they say how the run goes on
            add = f"--task {shlex.quote(own)}"
            error.add_note(f"and add {add} to the command, because this task is not installed")
        raise
    if quiet:
        print_result(run.path)
    else:
        _print_results(run, verbose=verbose)


def _print_results(run: Run, *, verbose: bool) -> None:
    """Print the figures that the display of the training had, and what to do next."""
    from serp.runs.oscillation import oscillation
    from serp.runs.results import return_of, title
    from serp.runs.step_account import unsafe_steps

    summary, recording = run.summary, run.recording()
    acted = {actor: share for actor, share in summary["shares"].items() if share}
    shares = ", ".join(f"{actor} {percent(share)}" for actor, share in acted.items())
    show(f"\n{run.path}: {title(summary)}")
    steps = plural(summary["env_steps"], "environment step")
    unsafe = f"{plural(summary['unsafe_executed'], 'unsafe action')} executed, "
    unsafe += f"{plural(summary['unsafe_observed'], 'step')} observed unsafe"
    unsafe += f"{unsafe_steps(recording)}, "
    rows = [
        ("steps", f"{steps}, {plural(summary['episodes'], 'episode')}"),
        ("return", f"{return_of(summary)}  {sparkline(run.metrics['return'])}"),
        ("who acted", f"{shares or '–'}; trained policy: {summary['trained_policy']}"),
        ("safety", f"{unsafe}{plural(summary['vetoes'], 'proposal')} refused"),
        ("time", duration(summary["wall_time"])),
    ]
    if (risk := summary["risk"]) and not verbose:
        rows.insert(-1, ("risk", risk))
    print_table(("", ""), rows)
    if (told := oscillation(run, recording)) is not None:
        show(f"\n{told}")
    if verbose:
        show()
        print_account(summary, summary["sight"])
    print_next(
        (again("evaluate", run=run), "how good the policy is now, without exploration"),
        (again("plan", run=run), "what its planner sees, and why"),
        (again("why", run=run), "what happened in a step, and the lines behind it"),
        (again("report", run=run), "the whole run as one page for the browser"),
        (again("diagnose", run=run), "what the file predicts wrongly"),
        (again("export", "-o", "FOLDER", run=run), "its policy, for a robot"),
    )
