from __future__ import annotations

import os
import sys

import pytest

from serp.errors import Notice, RunError
from serp.runs.folder import DECISIONS, RunFolder
from serp.runs.results import write_results
from serp.runs.rows import DecisionRow

CONFIG = {"domain": "cartpole", "preset": "default", "seed": 3}


def test_results_are_made_from_what_the_run_wrote(tmp_path, make_rows):
    with RunFolder.create(tmp_path / "x", CONFIG, [("d.pddl", "(define)")]) as run:
        for row in make_rows(25):
            run.metrics.append(row)
        row = DecisionRow(
            0, 1, "learner", "l", "r", "planner", "unsafe", True, 0, True, False, 0, 0.5, "falls"
        )  # fmt: skip
        for step in range(7):
            run.decisions.append(row._replace(step=step))
        write_results(run)
        assert run.read_summary()["episodes"] == 25
    text = (tmp_path / "x" / "report.md").read_text()
    assert "# Run: cartpole, preset default, seed 3" in text
    assert "| unsafe | 7 |" in text
    assert (tmp_path / "x" / "learning-curve.png").read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in (tmp_path / "x" / "learning-curve.svg").read_bytes()
    assert not [name for name in os.listdir(tmp_path / "x") if "aside" in name]


def test_without_matplotlib_there_is_no_curve_and_a_notice_says_so(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.delitem(sys.modules, "serp.runs.plots", raising=False)
    with RunFolder.create(tmp_path / "x", CONFIG, [("d.pddl", "(define)")]) as run:
        with pytest.warns(Notice, match=r"the learning curve needs .* pip install 'serp\[plots\]'"):
            write_results(run)
        assert run.read_summary()["episodes"] == 0
    assert "learning-curve" not in (tmp_path / "x" / "report.md").read_text()
    assert not list((tmp_path / "x").glob("learning-curve*"))


def test_a_table_that_was_changed_by_hand_is_named(tmp_path):
    with RunFolder.create(tmp_path / "x", CONFIG, [("d.pddl", "(define)")]) as run:
        with open(tmp_path / "x" / DECISIONS, "a") as file:
            file.write("1,2\n")
        with pytest.raises(RunError, match=r"decisions\.csv:2: 2 cells"):
            write_results(run)
