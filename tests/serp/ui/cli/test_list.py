"""`serp list`."""

from __future__ import annotations

import re
from importlib.metadata import EntryPoint

import pytest

from serp.runs.comparison.algorithms import OWN, algorithm_entries
from serp.settings import PRESETS as KNOWN
from serp.tasks.registry import GROUP, load_task, task_entries
from tests.serp.ui.cli.conftest import Run


def test_everything_installed_is_listed(run: Run) -> None:
    shown = run("list").stdout
    for name in task_entries():
        assert f"\n{name} " in shown
        assert load_task(name).description in shown
    for name in (*KNOWN, *OWN, *algorithm_entries(), "evidence", "mixture", "lookahead", "dqn"):
        assert f"\n{name} " in shown
    table = re.sub(" +", " ", shown.partition("\nplanner.name (--planner) ")[2])
    assert "\nfar-sight the planner that sees to the end of a finite task" in table


def test_a_task_that_cannot_be_loaded_hides_no_other(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = EntryPoint("broken", "no_such_package:task", GROUP)
    entries = {**task_entries(), "broken": broken}
    monkeypatch.setattr("serp.tasks.registry.task_entries", lambda: entries)
    shown = run("list").stdout
    assert "No module named 'no_such_package'" in shown
    assert "\ncartpole " in shown
