"""Columns, files, messages and names of the code that the pages list are those of the code."""

import ast
import pkgutil
import re
import tomllib
from pathlib import Path
from typing import get_args

import pytest

import serp
from serp.agent.decision import Actor, Reason
from serp.runs.comparison.algorithms import OWN, algorithm_entries
from serp.runs.comparison.compare import compare
from serp.runs.evaluation import Policy
from serp.runs.recording import COLUMNS
from serp.runs.tables import DECISIONS_COLUMNS, METRICS_COLUMNS
from serp.tasks.registry import task_entries
from serp.ui.root import COMMANDS, SECTIONS
from tests.docs.pages import PAGES, ROOT, code, name_of, prose, tables


def test_the_example_of_a_decision_log_has_its_columns_and_words():
    values = (each.values for each in tables("names of"))
    (table,) = (table for _, what, table in values if what == "decisions.csv")
    row = {code(name): value for name, value, _ in table}
    assert tuple(row) == DECISIONS_COLUMNS
    assert {row["proposed_by"], row["executed_by"]} <= {*Actor}
    assert row["reason"] in {*Reason}


def texts_of(node):
    """A text in the code, with `…` for what is filled in."""
    if isinstance(node, ast.JoinedStr):
        return "".join(texts_of(value) for value in node.values)
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else "…"


def test_messages_that_are_explained_are_those_of_the_code():
    page = (ROOT / "docs" / "how-to" / "troubleshooting.md").read_text(encoding="utf-8")
    page = page.partition("## By message")[2]
    quoted = re.findall(r"^\| `+ ?(.+?) ?`+ (?:\(.+\) )?\|", page, re.M)
    assert len(quoted) == len(re.findall(r"^\| .*`.*\|$", page, re.M)) >= 10
    said = "\n".join(
        {
            texts_of(node)
            for file in (ROOT / "serp").rglob("*.py")
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
            if isinstance(node, ast.JoinedStr | ast.Constant)
        }
    )
    for message in quoted:
        parts = [re.escape(part) for part in re.split(r"`?…`?", message) if part]
        assert re.search(".*".join(parts), said), message


def run_files():
    folder = Path("names")
    serp.plan_and_learn("cartpole", env_steps=30, out=folder, quiet=True)
    return {path.name + "/" * path.is_dir() for path in folder.iterdir()}


def comparison_files():
    folder = Path("compared")
    compare(
        "cartpole", algorithms=["mrp"], seeds=1, env_steps=30, final_episodes=1, out=folder,
        jobs=1, quiet=True,
    )  # fmt: skip
    return {path.name + "/" * path.is_dir() for path in folder.iterdir()}


def extras():
    """What users install; `docs` and `dev` are for developers."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return {*project["optional-dependencies"]} - {"docs", "dev"}


LISTS = {
    "metrics.csv": lambda: set(METRICS_COLUMNS),
    "decisions.csv": lambda: set(DECISIONS_COLUMNS),
    "actors": lambda: {actor.value for actor in Actor},
    "reasons": lambda: {reason.value for reason in Reason},
    "policies": lambda: set(get_args(Policy)),
    "run folder": run_files,
    "recording": lambda: set(COLUMNS),
    "algorithms": lambda: {*OWN, *algorithm_entries()},
    "tasks": lambda: set(task_entries()),
    "comparison folder": comparison_files,
    "extras": extras,
}
NOT_IN_EVERY_RUN = {"problem.pddl", "evaluations/", "film.mp4", "report.html"}


@pytest.mark.parametrize(("page", "what", "table"), tables("names of"))
def test_lists_of_names_are_complete(page, what, table, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    named = [name for row in table for name in re.findall(r"`([^`(]+)[^`]*`", row[0])]
    assert len(named) == len(set(named))
    expected = LISTS[what]()
    assert set(named) - expected <= NOT_IN_EVERY_RUN
    assert expected <= set(named)


def test_the_reference_has_every_command_in_the_sections_of_the_help():
    text = (ROOT / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
    shown = re.findall(r"^\.\. click:: serp.ui.commands.(.+):.+\n   :prog: serp (.+)$", text, re.M)
    assert [(name, module) for module, name in shown] == [*COMMANDS.items()]
    assert re.findall(r"^## (.+)$", text, re.M) == [*SECTIONS]


def test_the_reference_has_every_public_name():
    text = (ROOT / "docs" / "reference" / "api.md").read_text(encoding="utf-8")
    named = re.findall(r"^   serp\.(\w+)$", text, re.M)
    assert sorted(named) == sorted({*serp.__all__} - {"__version__"})


def test_code_that_is_named_exists():
    """Every `serp.module.name` in the pages."""
    kinds = ("tasks", "algorithms", "engines", "planners", "learners", "strategies")
    entry_points = {f"serp.{name}" for name in kinds}
    for page in PAGES:
        dotted = set(re.findall(r"`(serp(?:_\w+)?(?:\.\w+)+)(?:\([^`]*\))?`", prose(page)))
        for name in sorted(dotted - entry_points if page.name != "CHANGELOG.md" else ()):
            pkgutil.resolve_name(name)


def anchors(page):
    titles = re.findall(r"^#+ (.+)$", prose(page), re.M)
    return {re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", sorted(ROOT.glob("*.md")), ids=name_of)
def test_links_of_pages_outside_of_the_site_lead_somewhere(page):
    for target in re.findall(r"!?\[[^\]]*\]\(([^)\s]+)\)", prose(page)):
        if re.match(r"https?:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists() and file.is_relative_to(ROOT), target
        assert not anchor or anchor in anchors(file), target
