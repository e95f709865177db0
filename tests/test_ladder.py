"""The ladder of benchmarks: its differences pair the seeds, and its mechanisms exist."""

import csv
import re

import numpy as np
import pytest

from serp.settings import resolve
from serp.tasks.registry import task_entries
from tests.benchmarks import ladder, paper


@pytest.mark.parametrize("name", ladder.WITHOUT)
def test_a_mechanism_is_switched_off_by_what_exists(name):
    assert resolve("default", changes=ladder.changes_of([name]))
    for each in ladder.WITHOUT[name]:
        assert isinstance(each, str) or ladder.place_of(each[0])


def test_the_landed_numbers_are_those_of_all_tasks_and_variants():
    rows = ladder.read(ladder.ROOT / "docs" / "results" / "ladder.csv")
    assert {row["task"] for row in rows} == set(ladder.named()) > set(task_entries())
    assert all(row["avoidable_unsafe"] == 0 for row in rows)
    assert all(np.isfinite(row[name]) for row in rows for name in ladder.POLICIES)


def test_the_page_of_the_papers_figures_has_the_numbers_of_its_file():
    rows = list(csv.DictReader((paper.RESULTS / "paper.csv").read_text("utf-8").splitlines()))
    page = (paper.RESULTS / "paper.md").read_text("utf-8")
    assert {row["panel"] for row in rows} == set(paper.PANELS)
    # Intervals are resampled, which another version of SciPy may do otherwise.
    assert re.sub(r" \[.*?\]", "", paper.renewed(page, rows)) == re.sub(r" \[.*?\]", "", page)
