from __future__ import annotations

import re

import pytest

from serp.comparison.analysis.results import Results
from serp.comparison.report.figures import pictures
from serp.comparison.report.rendering import html_page
from serp.comparison.report.report import report_text, write_report
from serp.errors import RunError
from tests.serp.comparison.made_up import metadata, record, records, trial
from tests.serp.comparison.report.test_rendering import read


def texts(found, asked=None):
    """The report as Markdown and as a page, without its figures."""
    results = Results(found, asked or metadata(found))
    markdown = report_text(results, ())
    return markdown, html_page(markdown, results.metadata.task, {})


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A folder with a whole report of two domain files."""
    folder = tmp_path_factory.mktemp("report")
    found = [*records(), *(trial("serp", s, 70.0, variant="wrong") for s in range(3))]
    write_report(folder, Results(found, metadata(found, notes=["Made up."])))
    return folder


def test_a_report_can_be_read_alone(whole):
    text, html = ((whole / f"report.{kind}").read_text() for kind in ("md", "html"))
    for heading in (
        "# Comparison: walkway", "## What was compared", "## What is equal and what differs",
        "### Returns",
        "### Time until good", "### Safety and outcomes", "## Differences to serp",
        "## How bad may the model be?", "## How to reproduce",
        "## Definitions",
    ):  # fmt: skip
        assert f"\n{heading}\n" in "\n" + text
    assert "* Made up." in text
    assert "serp compare --domain walkway" in text
    assert "never (4 of 4)" in text
    assert "not complete" not in text
    for address in re.findall(r"!\[.*?\]\((.*?)\)", text):
        assert (whole / address).is_file()
        assert (whole / address).with_suffix(".png").is_file()
    reader = read(html)
    assert text.count("![") == len(reader.addresses) > 0
    assert all(address.startswith("data:image/") for address in reader.addresses)
    assert not {"script", "link", "iframe", "a"} & set(reader.tags)
    assert not re.search(r"https?://|url\(", html)


def test_names_that_hold_markup_are_shown_as_text():
    odd = "<script>|alert(1)|</script>\n# [x](http://x) ![y](z) `c`"
    found = [
        record([1.0] * 3, trial=(odd, odd, seed), outcomes=[odd] * 3, info={odd: [1] * 3},
               metadata={"characteristics": {odd: odd + str(seed)}})
        for seed in range(2)
    ] + [trial("serp", seed, 2.0, variant=odd) for seed in range(2)]  # fmt: skip
    asked = metadata(found, task=odd, base=odd, variants={odd: odd, "b": odd}, notes=[odd],
                  command=f"```\n{odd}", inputs=odd)  # fmt: skip
    text, html = texts(found, asked)
    reader = read(html)
    assert "script" not in reader.tags and "a" not in reader.tags
    assert not reader.addresses
    assert "&lt;script&gt;|alert(1)|&lt;/script&gt;" in html
    headings = [line for line in text.splitlines() if line.startswith("# ")]
    assert headings[0].startswith("# Comparison: \\<script\\>\\|")


def test_what_is_missing_is_said():
    found = records()
    asked = metadata(found)
    text, _ = texts([r for r in found if r.trial.algorithm != "dqn"][1:], asked)
    assert "7 of 12 trials are finished" in text
    assert "serp on base (seed 0); dqn on base (seeds 0 to 3)" in text
    text, _ = texts([], asked)
    assert "No trial has finished yet." in text


@pytest.mark.parametrize("seeds", [4, 5])
def test_intervals_and_verdicts_of_few_seeds_carry_a_warning(seeds):
    found = [*records(seeds=range(seeds)),
             *(trial("serp", s, 70.0, variant="wrong") for s in range(seeds))]  # fmt: skip
    text, html = texts(found)
    asking = re.findall(r"^#+ (.+)\n\n(?:(?!#).*\n)*?\*\*Few seeds \(4\)", text, re.M)
    shown = [
        "Comparison: walkway", "Returns", "Differences to serp", "How bad may the model be?",
    ]  # fmt: skip
    assert asking == (shown if seeds < 5 else [])
    assert ("Few seeds (4): intervals" in html) == (seeds < 5)


def test_equal_records_in_any_order_give_equal_files(whole, tmp_path):
    found = [*records(), *(trial("serp", s, 70.0, variant="wrong") for s in range(3))]
    asked = metadata(found, notes=["Made up."])
    write_report(tmp_path, Results(found[::-1], asked))
    one, other = (
        {file.relative_to(at): file.read_bytes() for file in at.rglob("*") if file.is_file()}
        for at in (whole, tmp_path)
    )
    assert one == other


def test_terms_are_sorted_into_equal_and_different():
    def one(name, seed, planner, gamma):
        settings = {"learner": {"gamma": gamma, "batch": 64}}
        more = {
            "characteristics": {"planner": planner, "reward": "the domain's"},
            "settings": settings,
        }
        return record([1.0], trial=(name, "base", seed), metadata=more)

    found = [one("serp", 0, "lookahead", 0.9), one("dqn", 0, "none", 0.97)]
    text, _ = texts(found)
    equal, different = text.split("What differs", 1)
    assert "| reward | the domain's |" in equal
    assert "| planner | lookahead | none |" in different
    assert "| learner.gamma | 0.9 | 0.97 |" in different
    assert "learner.batch" not in text
    text, _ = texts([*found, one("serp", 1, "lookahead", 0.5)])
    assert "The trials of serp were not made with the same settings." in text


def test_trials_of_the_base_file_may_be_missing():
    found = [
        trial(name, seed, 70.0, variant="wrong") for name in ("serp", "mrp") for seed in (0, 1)
    ]
    asked = metadata(found, variants={"base": "a", "wrong": "b", "third": "c"})
    text, _ = texts(found, asked)
    assert "## Results" not in text and "## Definitions" in text
    for picture in pictures(Results([*found, trial("serp", 0, 3.0, variant="third")], asked)):
        picture.figure.draw_without_rendering()


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(RunError, match="cannot write"):
        write_report(tmp_path / "no" / "such", Results([], metadata([])))


def test_without_a_threshold_the_report_has_none():
    found = records(seeds=[0, 1])
    text, _ = texts(found, metadata(found, threshold=None))
    assert "Time until good" not in text
    assert "never (" not in text
