from __future__ import annotations

from markdown_it import MarkdownIt

from serp.runs.report import report
from serp.runs.summary import summarize

ABOUT = {
    "created": "2026-11-21T04:05:06+00:00",
    "command": ["serp", "plan-and-learn", "--domain", "my cart.pddl"],
    "seed": 3,
    "domain_files": {"domain.pddl": "domains/my_cart.pddl"},
    "versions": {"numpy": "2.4.0", "torch": None},
    "machine": {"python": "CPython 3.11.7", "cores": 2},
}


def test_the_report_says_what_the_summary_says(make_metrics):
    summary = summarize(
        make_metrics(100),
        {"domain": "cartpole", "preset": "default"},
        {"proposal predicted unsafe": 1234, "below R_min | far": 5},
    )
    text = report(ABOUT, summary)
    assert text.startswith("# Run: cartpole, preset default, seed 3\n\n100 episodes, ")
    assert f"{summary['env_steps']:,} environment steps" in text
    assert "](learning-curve.png)" in text
    assert "| proposal predicted unsafe | 1,234 |" in text
    assert r"| below R\_min \| far | 5 |" in text
    assert f"| proposals vetoed | {summary['vetoes']:,} |" in text
    assert "serp plan-and-learn --domain 'my cart.pddl'" in text
    assert "| numpy | 2.4.0 |" in text and "torch" not in text
    assert r"domains/my\_cart.pddl" in text
    assert text.endswith("|\n") and "nan" not in text and "None" not in text


def test_a_run_that_has_just_begun_has_a_report(make_metrics):
    text = report({**ABOUT, "command": []}, summarize(make_metrics(0)))
    assert "No episode has ended yet." in text and "There were none." in text
    assert "```" not in text and "None" not in text


def test_nothing_in_a_configuration_becomes_markdown_or_html(make_metrics):
    hostile = "```\n<script>x</script> | [a](http://b) \x1b[31m\u202e # h"
    about = {
        "created": hostile, "command": ["serp", hostile, 3], "domain_files": {hostile: hostile},
        "versions": {hostile: hostile}, "machine": {hostile: hostile, "cores": [hostile]},
    }  # fmt: skip
    summary = summarize(make_metrics(3), {"domain": hostile, "preset": hostile, "seed": hostile})
    html = (
        MarkdownIt("commonmark")
        .enable("table")
        .render(report(about, {**summary, "vetoes_by_reason": {hostile: 1}}))
    )
    assert "<script" not in html and "<a " not in html
    assert html.count("<h1") == 1 and html.count("<pre>") == 1
    assert not set(html) & {"\x1b", "\u202e"}
