"""`serp list`: what is installed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from serp.cli.output import ExampledCommand, open_console, print_table

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

PRESETS = {
    "default": "what gives the best result today",
    "paper": "Algorithm 1 and section 4 of the paper to the letter",
}


@click.command(
    "list",
    cls=ExampledCommand,
    examples=["serp list"],
)
def command() -> None:
    """List the installed tasks, with their domain files, and the presets."""
    from serp.tasks.registry import task_entries

    console = open_console()
    rows, styles = [], []
    for name, entry in sorted(task_entries().items()):
        description, domain, broken = _about(name)
        rows.append((name, description, domain, _package(entry)))
        styles.append("red" if broken else "")
    if rows:
        print_table(console, ("task", "", "domain file", "package"), rows, styles=styles)
    else:
        console.print("No task is installed.")
    console.print("")
    print_table(console, ("preset", ""), list(PRESETS.items()))


def _about(name: str) -> tuple[str, str, bool]:
    """Return description and domain file of a task, and whether it cannot be loaded."""
    from serp.errors import SerpError
    from serp.model.loading import Domain
    from serp.tasks.registry import find_domain_file, load_task

    try:
        task = load_task(name)
    except SerpError as error:
        return str(error), "", True
    shipped = Path(task.domain.source.name if isinstance(task.domain, Domain) else task.domain)
    own = find_domain_file(name)
    if own is None:
        return task.description, str(shipped), False
    same = own.resolve() == shipped.resolve()
    return task.description, str(own) if same else f"{own} (instead of the installed one)", False


def _package(entry: EntryPoint) -> str:
    if entry.dist is None:
        return entry.value
    return f"{entry.dist.name} {entry.dist.version}"
