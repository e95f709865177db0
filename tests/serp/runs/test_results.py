"""The results of a run: a report that says what the summary says, and a curve."""

from __future__ import annotations

import os

import pytest
from markdown_it import MarkdownIt

from serp.runs.folder import RunFolder
from serp.runs.report import report, write_results
from serp.runs.summary import summarize
from serp.runs.tables import DecisionRow

CONFIG = {"domain": "cartpole", "preset": "default", "seed": 3}


@pytest.fixture
def run(tmp_path):
    with RunFolder.create(tmp_path / "x", CONFIG, [("d.pddl", "(define)")]) as run:
        yield run


def test_results_are_made_from_what_the_run_wrote(run, make_rows):
    for row in make_rows(25):
        run.metrics.append(row)
    row = DecisionRow(
        0, 1, "learner", "l", "r", "planner", "unsafe", True, 0, True, False, 0, 0.5, 3, "depth",
        False,
    )  # fmt: skip
    for step in range(7):
        run.decisions.append(row._replace(step=step))
    write_results(run)
    assert run.read_summary()["episodes"] == 25
    text = (run.path / "report.md").read_text()
    assert "# Run: cartpole, preset default, seed 3" in text
    assert "| unsafe | 7 |" in text
    assert (run.path / "learning-curve.png").read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in (run.path / "learning-curve.svg").read_bytes()
    assert not [name for name in os.listdir(run.path) if "aside" in name]


def test_nothing_in_a_configuration_becomes_markdown_or_html(make_metrics):
    hostile = "```\n<script>x</script> | [a](http://b) \x1b[31m\u202e # h"
    metadata = {
        "created": hostile, "command": ["serp", hostile, 3], "domain_files": {hostile: hostile},
        "versions": {hostile: hostile}, "machine": {hostile: hostile, "cores": [hostile]},
    }  # fmt: skip
    config = {"domain": hostile, "preset": hostile, "seed": hostile}
    model = {"sentence": hostile}
    account = {"trained_policy": hostile, "evidence": None, "model": model}
    text = report(metadata, summarize(make_metrics(3), config, {hostile: 1}, account=account))
    html = MarkdownIt("commonmark").enable("table").render(text)
    assert "<script" not in html and "<a " not in html
    assert html.count("<h1") == 1 and html.count("<pre>") == 1
    assert not set(html) & {"\x1b", "\u202e"}
