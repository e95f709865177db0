"""`serp new`: the first files of a task."""

from __future__ import annotations

from pathlib import Path

import click

from serp.ui.output import examples, open_console, print_next


@click.command(
    "new",
    epilog=examples(
        "serp new delivery",
        "serp new mountain --env MountainCar-v0",
        "serp new my-robot --env my_env.py:Robot",
    ),
)
@click.argument("name", type=click.Path(path_type=Path))
@click.option("--env", metavar="ID|FILE.py:CLASS",
              help="A Gymnasium environment: ID, PACKAGE:ID or a class of yours.")  # fmt: skip
def command(name: Path, env: str | None) -> None:
    """Write the first files of the task NAME; none is overwritten.

    With --env these are NAME.pddl, a frame of a domain file with the environment's actions and the
    numbers of its observations, and NAME.py, the task that adapts it. What is known of the
    environment is yours to write; check and plan-and-learn work at once.

    Without --env it is an example whose world is the file itself, for `serp play`. NAME.scenarios
    is for what you expect of the file, for `serp test`.
    """
    from serp.authoring.scaffold import new_task

    files = new_task(name, env)
    domain = files[0]
    console = open_console()
    for file in files:
        console.print(f"written: {file}")
    rows = [
        (f"serp play {domain}", "step it by hand; `?` asks the planner"),
        (f"serp check {domain}", "does it make sense, after each change"),
        (f"serp test {domain}", "does the planner do what you expect"),
        (f"serp plan-and-learn --domain {domain}", "let a learner practise in it"),
    ]
    if env is not None:
        task = files[1]
        rows = [
            (str(domain), "say what the actions change, what is good, what must not happen"),
            (f"serp check {domain} --task {task}", "does it fit together, after each change"),
            (f"serp plan --task {task} --observe", "what the planner would do"),
            (f"serp plan-and-learn --task {task}", "train"),
        ]
    print_next(console, *rows)
