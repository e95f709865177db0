from __future__ import annotations

import base64
import re
from html.parser import HTMLParser

import pytest

from serp.errors import RunError
from serp.runs.comparison.charts import pictures
from serp.runs.comparison.measures import Results
from serp.runs.comparison.report import html_page, report_text, write_report
from tests.serp.runs.comparison.made_up import metadata, record, records, trial

SVG = b'<svg xmlns="http://www.w3.org/2000/svg"/>'
OF_TWO_FILES = [*records(), *(trial("serp", s, 70.0, variant="wrong") for s in range(3))]
ASKED = metadata(OF_TWO_FILES, notes=["Made up."])


class Reader(HTMLParser):
    """Every tag and every address of a page."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.addresses = [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [value for name, value in attrs if name in ("src", "href", "data")]


def text_of(found, asked=None):
    """The report as Markdown, without its figures."""
    return report_text(Results(found, asked or metadata(found)), ())


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A folder with a whole report of two domain files."""
    folder = tmp_path_factory.mktemp("report")
    write_report(folder, Results(OF_TWO_FILES, ASKED))
    return folder


def test_a_report_can_be_read_alone(whole):
    text, page = ((whole / f"report.{kind}").read_text() for kind in ("md", "html"))
    for heading in (
        "# Comparison: walkway", "## What was compared", "## What is equal and what differs",
        "### Returns", "### Time until good", "### Safety and outcomes", "## Differences to serp",
        "## How bad may the model be?", "## How to reproduce", "## Definitions",
    ):  # fmt: skip
        assert f"\n{heading}\n" in "\n" + text
    for part in ("* Made up.", "serp compare --domain walkway", "never (4 of 4)", "**Few seeds (3"):
        assert part in text
    assert "not complete" not in text
    for address in re.findall(r"!\[.*?\]\((.*?)\)", text):
        assert (whole / address).is_file()
        assert (whole / address).with_suffix(".png").is_file()
    reader = Reader(page)
    assert text.count("![") == len(reader.addresses) > 0
    assert all(address.startswith("data:image/") for address in reader.addresses)
    assert not {"script", "link", "iframe", "a"} & set(reader.tags)
    assert not re.search(r"https?://|url\(", page)


def test_who_leads_is_told_where_a_strategy_says_so():
    assert "### Who leads" not in text_of(records())
    lead = {"rho": 0.5, "evidence": {"planner": None, "learner": {"mean": 7.0}}}
    text = text_of([trial("serp", 0, 90.0, metadata={"lead": lead}), trial("dqn", 0, 30.0)])
    table = text.split("### Who leads\n")[1].split("###")[0]
    assert "| ρ |" in table and "that the learner leads" in table
    assert "that the planner leads" not in table


def test_a_page_holds_its_pictures_and_shows_html_as_text():
    report = "![a picture](figures/x.svg)\n\n<script>alert(1)</script> & <b>x</b>\n\n"
    page = html_page(report + "| a | b |\n|---|---:|\n| 1 | 2 |\n", "</title><script>",
                     {"figures/x.svg": SVG})  # fmt: skip
    reader = Reader(page)
    (address,) = reader.addresses
    assert address == f"data:image/svg+xml;base64,{base64.b64encode(SVG).decode()}"
    assert not {"script", "b"} & set(reader.tags)
    assert "&lt;script&gt;alert" in page and "default-src 'none'" in page
    assert '<div class="wide"><table>' in page
    assert page.count("<div") == page.count("</div>") == 1


def test_names_that_hold_markup_are_shown_as_text():
    odd = "<script>|alert(1)|</script>\n# [x](http://x) ![y](z) `c`"
    found = [
        record([1.0] * 3, trial=(odd, odd, seed), outcomes=[odd] * 3, info={odd: [1] * 3},
               metadata={"characteristics": {odd: odd + str(seed)}})
        for seed in range(2)
    ] + [trial("serp", seed, 2.0, variant=odd) for seed in range(2)]  # fmt: skip
    about = {"notes": [odd], "command": f"```\n{odd}", "machine": {odd: odd}}
    asked = metadata(found, task=odd, variants=(odd, "b"), **about)
    text = text_of(found, asked)
    page = html_page(text, odd, {})
    reader = Reader(page)
    assert "script" not in reader.tags and "a" not in reader.tags
    assert not reader.addresses
    assert "&lt;script&gt;|alert(1)|&lt;/script&gt;" in page
    headings = [line for line in text.splitlines() if line.startswith("# ")]
    assert headings[0].startswith("# Comparison: \\<script\\>\\|")


def test_what_is_missing_is_said():
    found = records()
    text = text_of([r for r in found if r.trial.algorithm != "dqn"][1:], metadata(found))
    assert "7 of 12 trials are finished" in text
    assert "Missing: serp on base, seed 0; dqn on base, seed 0; dqn on base, seed 1" in text
    assert "No trial has finished yet." in text_of([], metadata(found))


def test_equal_records_in_any_order_give_equal_files(whole, tmp_path):
    write_report(tmp_path, Results(OF_TWO_FILES[::-1], ASKED))
    one, other = (
        {file.relative_to(at): file.read_bytes() for file in at.rglob("*") if file.is_file()}
        for at in (whole, tmp_path)
    )
    assert one == other


def test_settings_that_differ_are_shown():
    def one(name, planner, gamma):
        settings = {"learner": {"gamma": gamma, "batch": 64}}
        more = {"characteristics": {"planner": planner}, "settings": settings}
        return record([1.0], trial=(name, "base", 0), metadata=more)

    text = text_of([one("serp", "lookahead", 0.9), one("dqn", "none", 0.97)])
    assert "| planner | lookahead | none |" in text
    assert "| learner.gamma | 0.9 | 0.97 |" in text
    assert "learner.batch" not in text


def test_trials_of_the_base_file_may_be_missing():
    found = [
        trial(name, seed, 70.0, variant="wrong") for name in ("serp", "mrp") for seed in (0, 1)
    ]
    asked = metadata(found, variants=("base", "wrong", "third"))
    text = text_of(found, asked)
    assert "## Results" not in text and "## Definitions" in text
    for picture in pictures(Results([*found, trial("serp", 0, 3.0, variant="third")], asked)):
        picture.figure.draw_without_rendering()


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(RunError, match="cannot write"):
        write_report(tmp_path / "no" / "such", Results([], metadata([])))


def test_without_a_threshold_the_report_has_none():
    found = records(seeds=[0, 1])
    text = text_of(found, metadata(found, threshold=None))
    assert "Time until good" not in text
    assert "never (" not in text
