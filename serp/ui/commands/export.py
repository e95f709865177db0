"""`serp export`: the trained policy of a run as a folder that a robot decides by."""

from __future__ import annotations

from pathlib import Path

import click

from serp.ui.asked import open_run
from serp.ui.options import own_task_option
from serp.ui.output import examples
from serp.ui.root import say


@click.command(
    "export",
    epilog=examples("serp export runs/seven -o policy", "serp export runs/seven -o robot/policy"),
)
@click.argument("run", type=click.Path(path_type=Path))
@own_task_option
@click.option("-o", "--out", type=click.Path(path_type=Path), required=True, metavar="FOLDER",
              help="The new folder.")  # fmt: skip
def command(run: Path, out: Path) -> None:
    """Export the trained policy of RUN, the folder that plan-and-learn made, to FOLDER.

    FOLDER holds the domain file and what the agent has learned. A robot with serp decides by it,
    without the environment of the task.
    """
    from serp.runs.policy import export_policy

    export_policy(open_run(run), out)
    say(f"{out} holds the policy. On the robot: serp.Policy({str(out)!r}).decide(observation)")
