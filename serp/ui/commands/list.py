"""`serp list`: what is installed."""

from __future__ import annotations

from importlib.metadata import EntryPoint

from serp.errors import SerpError
from serp.ui.options import command
from serp.ui.output import print_table, show


@command("serp list")
def list() -> None:
    """List what is installed: tasks, algorithms, strategies."""
    from serp._util.plugins import offered
    from serp.agent.registry import KINDS, PLANNERS
    from serp.runs.comparison.algorithms import GROUP, OWN
    from serp.runs.comparison.pool import GROUP as ENGINES
    from serp.runs.comparison.pool import LOCAL
    from serp.settings import ABOUT_PRESETS
    from serp.tasks.registry import task_entries

    rows = [(name, *_describe_task(name)) for name in sorted(task_entries())]
    print_table(("task", "", "domain file"), rows)
    own = {name: algorithm.description for name, algorithm in OWN.items()}
    groups = {GROUP: ("algorithm", "algorithm (serp compare)", own)} | {
        group: (what, f"{setting} ({'--planner' if group == PLANNERS else '--set'})", {})
        for group, (what, setting) in KINDS.items()
    }
    groups[ENGINES] = "engine", "engine (serp compare)", {LOCAL: "processes on this machine"}
    show()
    print_table(("preset", ""), [*ABOUT_PRESETS.items()])
    for group, (what, title, known) in groups.items():
        installed = sorted(offered(group).items())
        show()
        print_table(
            (title, ""),
            [*known.items(), *((name, _first_line(entry, what)) for name, entry in installed)],
        )


def _first_line(entry: EntryPoint, what: str) -> str:
    """Return how an implementation describes itself, or why it cannot be loaded."""
    from serp._util.plugins import first_line, loading

    try:
        with loading(entry, what, SerpError):
            return first_line(entry.load())
    except SerpError as error:
        return str(error)


def _describe_task(name: str) -> tuple[str, str]:
    """Return description and domain file of a task, or why it cannot be loaded."""
    from serp.model.domain import Domain
    from serp.tasks.registry import find_domain_file, load_task

    try:
        task = load_task(name)
    except SerpError as error:
        return str(error), ""
    shipped = task.domain.source.name if isinstance(task.domain, Domain) else task.domain
    return task.description, str(find_domain_file(name) or shipped)
