"""`serp list`: what is installed."""

from __future__ import annotations

from importlib.metadata import EntryPoint
from pathlib import Path

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
    from serp.tasks.registry import task_entries

    rows, styles = [], []
    for name in sorted(task_entries()):
        description, domain, broken = _about(name)
        rows.append((name, description, domain))
        styles.append("red" if broken else "")
    if rows:
        print_table(("task", "", "domain file"), rows, styles=styles)
    else:
        show("No task is installed.")
    own = {name: algorithm.description for name, algorithm in OWN.items()}
    groups = {GROUP: ("algorithm", "algorithm (serp compare)", own)} | {
        group: (what, f"{setting} ({'--planner' if group == PLANNERS else '--set'})", {})
        for group, (what, setting) in KINDS.items()
    }
    groups[ENGINES] = "engine", "engine (serp compare)", {LOCAL: "processes of this machine"}
    show("")
    presets = [
        ("default", "what gives the best result today"),
        ("paper", "Algorithm 1 and section 4 of the paper to the letter"),
    ]
    print_table(("preset", ""), presets)
    for group, (what, title, known) in groups.items():
        shown = [*known.items()]
        styles = [""] * len(shown)
        for name, entry in sorted(offered(group).items()):
            description, broken = _first_line(entry, what)
            shown.append((name, description))
            styles.append("red" if broken else "")
        show("")
        print_table((title, ""), shown, styles=styles)


def _first_line(entry: EntryPoint, what: str) -> tuple[str, bool]:
    """Return how an implementation describes itself, and whether it cannot be loaded."""
    from serp._util.plugins import first_line, loading
    from serp.errors import SerpError

    try:
        with loading(entry, what, SerpError):
            return first_line(entry.load()), False
    except SerpError as error:
        return str(error), True


def _about(name: str) -> tuple[str, str, bool]:
    """Return description and domain file of a task, and whether it cannot be loaded."""
    from serp.errors import SerpError
    from serp.model.domain import Domain
    from serp.tasks.registry import find_domain_file, load_task

    try:
        task = load_task(name)
    except SerpError as error:
        return str(error), "", True
    shipped = Path(task.domain.source.name if isinstance(task.domain, Domain) else task.domain)
    used = find_domain_file(name) or shipped
    replaced = used.resolve() != shipped.resolve()
    return task.description, f"{used}{' (instead of the installed one)' * replaced}", False
