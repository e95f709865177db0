"""What the commands that run a trained policy have in common: which run, and which policy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import click

from serp.cli.failures import say
from serp.cli.tasks import asked_own_task, own_task_option
from serp.training.policies import Policy

if TYPE_CHECKING:
    from serp.training.run import Run


def policy_of_run(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the argument RUN and the options --policy and --task."""
    option = click.option("--policy", type=click.Choice(get_args(Policy)),
                          default="serp", show_default=True,
                          help="serp: the learner's choice within the vetoes; planner: the "
                               "planner alone; learner: the learner alone, no veto; training: who "
                               "acts in training, planner or learner, within the vetoes. None "
                               "explores.")  # fmt: skip
    run = click.argument("run", type=click.Path(path_type=Path))
    return run(option(own_task_option(command)))


def open_run(folder: Path) -> Run:
    """Open a run, and say what is to be known of its agent."""
    from serp.training.run import load_run

    run = load_run(folder, asked_own_task())
    if run.notice is not None:
        say(run.notice)
    return run
