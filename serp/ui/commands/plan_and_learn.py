"""`serp plan-and-learn`: train, or continue a training."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from serp._util.text import plural, readable
from serp.ui.asked import asked_task
from serp.ui.options import (
    domain_option,
    own_task_name,
    own_task_option,
    refuse_given,
    settings_option,
)
from serp.ui.output import examples, open_console, print_next, print_result, print_table
from serp.ui.root import say, stopped_by
from serp.ui.trained import print_account, unsafe_text

if TYPE_CHECKING:
    from serp.runs.run import Run


@click.command(
    "plan-and-learn",
    epilog=examples(
        "serp plan-and-learn --domain cartpole",
        "serp plan-and-learn --domain cartpole --episodes 300 --seed 7 --out runs/seven",
        "serp plan-and-learn --task my_robot.py",
        "serp plan-and-learn --resume runs/seven --episodes 500",
    ),
)
@domain_option
@own_task_option
@click.option("--preset", metavar="default|paper", default="default", show_default=True,
              help="Settings to begin with.")  # fmt: skip
@click.option("--episodes", type=click.IntRange(min=1), metavar="N",
              help="Train until N episodes have ended.")  # fmt: skip
@click.option("--env-steps", type=click.IntRange(min=1), metavar="N",
              help="Train for N steps in the environment.")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, metavar="N",
              help="Seed of everything random.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR",
              help="Folder of the run.  [default: runs/<domain>-<time>]")  # fmt: skip
@click.option("--resume", is_flag=False, flag_value="", metavar="[RUN]",
              help="Continue a run: this one, or that in --out.")  # fmt: skip
@click.option("--adapt", metavar="off|parameters|residual|full|rewards",
              help="What the model learns from its errors.  [default: by the preset]")  # fmt: skip
@click.option("--planner", metavar="NAME", help="The planner.  [default: by the preset]")
@click.option("--num-envs", type=click.IntRange(min=1), metavar="N",
              help="Step N environments at the same time.  [default: 1]")  # fmt: skip
@settings_option
@click.option("--quiet", is_flag=True, help="No display; print the run's folder alone.")
def command(
    domain: str | None,
    out: Path | None,
    resume: str | None,
    adapt: str | None,
    planner: str | None,
    num_envs: int | None,
    settings: dict[str, dict[str, Any]],
    quiet: bool,
    **options: Any,
) -> int | None:
    """Train on a task, or continue a training.

    The planner acts from the first step and the learner takes over; what the domain file flags
    unsafe is refused whenever there is a choice.

    A run that Ctrl-C, SIGTERM or SIGHUP stops (exit status 130, 143, 129) has lost nothing: the
    episode is finished first. A second one stops at once, and the run goes on from its last
    checkpoint.
    """
    _set(settings, "adaptation", "mode", "--adapt", adapt)
    _set(settings, "planner", "name", "--planner", planner)
    _set(settings, "training", "num_envs", "--num-envs", num_envs)
    resuming = resume is not None
    path = out if resume is None else _run_to_resume(resume, out)
    task = asked_task(domain)
    if task is None and not resuming:
        raise click.UsageError(
            "give --domain (`serp list` names the tasks), --task, or --resume RUN"
        )
    from serp.errors import Interrupted
    from serp.runs.train import plan_and_learn

    try:
        run = plan_and_learn(
            task or str(path), settings=settings, out=path, resume=resuming, quiet=quiet, **options
        )
    except BaseException as error:
        notes = getattr(error, "__notes__", [])  # how the run goes on
        if notes and (own := _own_task()):
            error.add_note(f"and add{own} to the command, for this task is not installed")
        stopped = isinstance(error, KeyboardInterrupt) and notes
        if not (stopped or isinstance(error, Interrupted)):
            raise
        message = "Stopped at once." if stopped else str(error)
        say("\n".join([message, *notes]))
        return stopped_by(error)
    if quiet:
        print_result(run.path)
    else:
        _print_results(run)
    return None


def _set(
    settings: dict[str, dict[str, Any]], section: str, name: str, option: str, value: Any
) -> None:
    """Set what an option of its own says, unless `--set` says it, too."""
    if value is None:
        return
    if name in settings.setdefault(section, {}):
        raise click.UsageError(f"give {option} or --set {section}.{name}, not both")
    settings[section][name] = value


def _run_to_resume(given: str, out: Path | None) -> Path:
    """Return the run that `--resume` means; what belongs to its beginning cannot be given."""
    refuse_given(
        ("preset", "seed", "adapt", "planner", "num_envs", "settings"),
        "cannot change in a run that is resumed",
    )
    if given and out is not None and Path(given) != out:
        raise click.UsageError(f"which run: --resume {given} or --out {out}?")
    path = Path(given) if given else out
    if path is None:
        raise click.UsageError("give the run to continue: --resume RUN")
    return path


def _own_task() -> str:
    """Return `--task` as it was given, for a command that is to be typed next."""
    name = own_task_name()
    return f" --task {shlex.quote(name)}" if name is not None else ""


def _print_results(run: Run) -> None:
    summary: dict[str, Any] = run.summary
    episodes, returns = plural(summary["episodes"], "episode"), summary["return"]
    mean = f"{readable(returns['mean'])} on average"
    if returns["last_20"] is not None:
        mean += f", {readable(returns['first_10'])} in the first 10 episodes, "
        mean += f"{readable(returns['last_20'])} in the last 20"
    quoted = shlex.quote(str(run.path))
    console = open_console()
    console.print("")
    print_table(
        console,
        ("", ""),
        [
            ("run", str(run.path)),
            ("length", f"{episodes}, {plural(summary['env_steps'], 'env step')}"),
            ("return", mean),
            ("terminated", f"{plural(summary['terminations'], 'episode')} ended by the environment "
                           "(a fall, a crash, the goal)"),
            ("vetoes", f"{plural(summary['vetoes'], 'proposal')} refused"),
            ("unsafe", unsafe_text(summary)),
        ],
    )  # fmt: skip
    console.print("")
    print_account(console, summary, summary["sight"])
    print_next(
        console,
        (f"serp evaluate {quoted}{_own_task()}", "how good it is now, without exploration"),
        (f"serp plan {quoted}{_own_task()}", "what its planner sees, and why"),
        (f"serp why {quoted}", "what happened in a step, and the lines behind it"),
        (f"serp report {quoted}{_own_task()}", "the whole run as one page for the browser"),
    )
