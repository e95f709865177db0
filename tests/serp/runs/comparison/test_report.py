"""The report: a page that can be read alone, and the numbers for programs."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from serp.runs.comparison.report import html_page, pictures, write_report
from serp.runs.comparison.statistics import Results
from serp.runs.comparison.trial import Record
from tests.serp.runs.comparison.contest import job, walk
from tests.serp.runs.comparison.made_up import plan_of, record, records


def written(folder: Path, found: Sequence[Record], notes: Sequence[str] = ("Made up.",)) -> Results:
    """Write the report of some records, and of the same comparison's missing trials."""
    results = Results(found, plan_of(found))
    jobs = [job(walk(folder), name, folder / "x") for name in ("serp", "mrp", "dqn")]
    write_report(folder, results, jobs, notes)
    return results


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a whole report."""
    folder = tmp_path_factory.mktemp("report")
    written(folder, records())
    return folder


class Reader(HTMLParser):
    """Every tag and every address of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.addresses: list[Any] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.tags.append(tag)
        self.addresses += [value for name, value in attrs if name in ("src", "href", "data")]


def test_a_report_can_be_read_alone(whole: Path) -> None:
    text, page = ((whole / f"report.{kind}").read_text() for kind in ("md", "html"))
    headings = "What was compared", "What differs", "Results", "Differences to serp", "Definitions"
    for heading in headings:
        assert f"\n## {heading}\n" in text
    for part in (
        "* Made up.",
        "never in 4 of 4",
        "**Few seeds (4)",
        "the learner of preset default alone",
        "dqn − serp",
    ):
        assert part in text
    for address in re.findall(r"!\[.*?\]\((.*?)\)", text):
        assert (whole / address).is_file() and (whole / address).with_suffix(".png").is_file()
    reader = Reader(page)
    assert text.count("![") == len(reader.addresses) == 2
    assert all(address.startswith("data:image/") for address in reader.addresses)
    assert not {"script", "link", "iframe", "a"} & set(reader.tags)
    assert not re.search(r"https?://|url\(", page)


def test_every_number_is_in_a_file_for_programs(whole: Path) -> None:
    with open(whole / "measures.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * 4
    assert {row["threshold_env_steps"] for row in rows if row["algorithm"] == "dqn"} == {"inf"}
    assert {row["final_learner"] for row in rows if row["algorithm"] == "mrp"} == {""}


@pytest.mark.parametrize("found", [[], [record([])], [record([1.0])]])
def test_a_report_of_next_to_nothing_says_so(tmp_path: Path, found: list[Record]) -> None:
    plan = plan_of(found, algorithms=("serp",), seeds=(0,))
    todo = [job(walk(tmp_path), "serp", tmp_path / str(seed), seed=seed) for seed in (0, 1)]
    write_report(tmp_path, Results(found, plan), todo, ())
    text = (tmp_path / "report.md").read_text()
    assert f"{len(found)} of 2 trials are finished" in text
    assert ("No trial has finished yet." in text) == (not found)


def test_names_are_shown_as_they_are(tmp_path: Path) -> None:
    odd = "<b>$x$</b>|*"
    found = [record([1.0] * 30, trial=(odd, 0), evaluations=[(600, "learner", 1.0)])]
    results = Results(found, plan_of(found))
    drawn = pictures(results)
    page = html_page(f"# {odd}\n\n![a](figures/x.svg)", odd, {"figures/x.svg": b"<svg/>"})
    assert [picture.name for picture in drawn] == ["training", "learner"]
    assert "<b>" not in page and page.count("<img") == 1
