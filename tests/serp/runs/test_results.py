"""The results of a run: a report that says what the summary says, and a curve."""

from __future__ import annotations

import os
import sys

import pytest
from markdown_it import MarkdownIt

from serp.errors import Notice, RunError
from serp.runs.folder import DECISIONS, RunFolder
from serp.runs.report import report, write_results
from serp.runs.summary import summarize
from serp.runs.tables import DecisionRow

CONFIG = {"domain": "cartpole", "preset": "default", "seed": 3}
METADATA = {
    "created": "2026-11-21T04:05:06+00:00",
    "command": ["serp", "plan-and-learn", "--domain", "my cart.pddl"],
    "domain_files": {"domain.pddl": "domains/my_cart.pddl"},
    "versions": {"numpy": "2.4.0", "torch": None},
    "machine": {"python": "CPython 3.11.7", "cores": 2},
}


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


def test_without_matplotlib_there_is_no_curve_and_a_notice_says_so(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.delitem(sys.modules, "serp.runs.learning_curve", raising=False)
    with pytest.warns(Notice, match=r"the learning curve needs .* pip install 'serp\[plots\]'"):
        write_results(run)
    assert run.read_summary()["episodes"] == 0
    assert "learning-curve" not in (run.path / "report.md").read_text()
    assert not list(run.path.glob("learning-curve*"))


def test_a_table_that_was_changed_by_hand_is_named(run):
    with open(run.path / DECISIONS, "a") as file:
        file.write("1,2\n")
    with pytest.raises(RunError, match=r"decisions\.csv:2: 2 cells"):
        write_results(run)


def test_the_report_says_what_the_summary_says(make_metrics):
    account = {
        "trained_policy": "the planner's choice",
        "evidence": {"sentence": "an episode is worth 3 ± 1"},
        "model": {"sentence": "adapted: residual for v"},
    }
    vetoes = {"proposal predicted unsafe": 1234, "below R_min | far": 5}
    summary = summarize(make_metrics(100), CONFIG, vetoes, account=account)
    assert {name: summary[name] for name in account} == account
    text = report(METADATA, summary)
    assert text.startswith("# Run: cartpole, preset default, seed 3\n\n100 episodes, ")
    assert f"{summary['env_steps']:,} environment steps" in text
    assert "](learning-curve.png)" in text
    assert r"| below R\_min \| far | 5 |" in text
    assert "serp plan-and-learn --domain 'my cart.pddl'" in text
    for word in account.values():
        assert (word if isinstance(word, str) else word["sentence"]) in text
    begun = report({**METADATA, "command": []}, summarize(make_metrics(0), CONFIG))
    assert "No episode has ended yet." in begun and "```" not in begun and "None" not in begun


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
