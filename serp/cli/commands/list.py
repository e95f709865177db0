"""`serp list`: what is installed."""

from __future__ import annotations

from importlib.metadata import EntryPoint
from pathlib import Path

import click

from serp.cli.output import examples, open_console, print_table

PRESETS = {
    "default": "what gives the best result today",
    "paper": "Algorithm 1 and section 4 of the paper to the letter",
}


@click.command("list", epilog=examples("serp list"))
def command() -> None:
    """List the installed tasks, with their domain files, and what the settings can name."""
    from serp._util.plugins import offered
    from serp.comparison.algorithms import OWN, algorithm_entries
    from serp.control.registry import LEARNERS, PLANNERS, STRATEGIES
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
    algorithms = [(name, algorithm.description) for name, algorithm in OWN.items()]
    algorithms += [(name, _package(entry)) for name, entry in algorithm_entries().items()]
    tables = {"preset": list(PRESETS.items()), "algorithm (serp compare)": algorithms}
    for setting, group in (
        ("guide.strategy", STRATEGIES), ("planner.name", PLANNERS), ("learner.name", LEARNERS)
    ):  # fmt: skip
        found = sorted(offered(group).items())
        tables[f"{setting} (--set)"] = [(name, _package(entry)) for name, entry in found]
    for title, lines in tables.items():
        console.print("")
        print_table(console, (title, ""), lines)


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
