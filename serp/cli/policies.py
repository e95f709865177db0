"""What the commands that run a trained policy have in common: which run, and which policy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import click

from serp.cli.failures import say
from serp.policies import Policy

if TYPE_CHECKING:
    from serp.run import Run


def policy_of_run(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the argument RUN and the option --policy."""
    option = click.option("--policy", type=click.Choice(get_args(Policy)),
                          default="serp", show_default=True,
                          help="serp: the learner's choice within the vetoes; planner: the "
                               "planner alone; learner: the learner alone, no veto; training: who "
                               "acts in training, planner or learner, within the vetoes. None "
                               "explores.")  # fmt: skip
    return click.argument("run", type=click.Path(path_type=Path))(option(command))


def open_run(folder: Path) -> Run:
    """Open a run, and say what is to be known of its agent."""
    from serp.run import load_run

    run = load_run(folder)
    if run.notice is not None:
        say(run.notice)
    return run
