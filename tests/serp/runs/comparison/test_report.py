"""The report: a page that can be read alone, and the numbers for programs."""

import csv
import re

import pytest

from serp.runs.comparison.report import write_report
from serp.runs.comparison.statistics import Results
from tests.serp.runs.comparison.contest import job, walk
from tests.serp.runs.comparison.made_up import plan_of, record, records


def written(folder, found):
    """Write the report of some records, and of the same comparison's missing trials."""
    results = Results(found, plan_of(found))
    jobs = [job(walk(folder), name, folder / "x") for name in ("serp", "mrp", "dqn")]
    write_report(folder, results, jobs)
    return results


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A folder with a whole report."""
    folder = tmp_path_factory.mktemp("report")
    written(folder, records())
    return folder


def test_a_report_can_be_read_alone(whole):
    page = (whole / "report.html").read_text()
    headings = [
        "What was compared",
        "How the algorithms differ",
        "All results",
        "Differences from serp",
        "Definitions",
    ]
    assert re.findall("<summary>(.*)</summary>", page) == headings
    learner = "only the learner of preset"
    for part in (
        "4 seeds each",
        "domain file, the planner",
        "never in 4 of 4",
        "Few seeds (4)",
        learner,
        "dqn − serp",
    ):
        assert part in page
    addresses = re.findall(r'(?:src|href|data)="([^"]*)"', page)
    assert len(addresses) == 2
    assert all(address.startswith("data:image/") for address in addresses)
    assert not re.search(r"<(script|link|iframe|a)\b", page)
    assert not re.search(r"https?://|url\(", page)
    for name in ("learner", "training"):
        assert (whole / "figures" / f"{name}.svg").is_file()
        assert (whole / "figures" / f"{name}.png").is_file()


def test_every_number_is_in_a_file_for_programs(whole):
    with open(whole / "measures.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * 4
    assert {row["threshold_env_steps"] for row in rows if row["algorithm"] == "dqn"} == {"inf"}
    assert {row["final_learner"] for row in rows if row["algorithm"] == "mrp"} == {""}


@pytest.mark.parametrize("found", [[], [record([])], [record([1.0])]])
def test_a_report_of_next_to_nothing_says_so(tmp_path, found):
    plan = plan_of(found, algorithms=("serp",), seeds=(0,))
    todo = [job(walk(tmp_path), "serp", tmp_path / str(seed), seed=seed) for seed in (0, 1)]
    write_report(tmp_path, Results(found, plan), todo)
    text = (tmp_path / "report.html").read_text()
    assert f"{len(found)} of 2 trials are finished" in text
    assert ("No trial has finished yet." in text) == (not found)


def test_names_are_shown_as_they_are(tmp_path):
    odd = "<b>$x$</b>|*\u202e"
    found = [record([1.0] * 30, trial=(odd, 0), evaluations=[(600, "learner", 1.0)])]
    written(tmp_path, found)
    page = (tmp_path / "report.html").read_text()
    assert "<b>" not in page and "&lt;b&gt;$x$&lt;/b&gt;|*\\u202e" in page
