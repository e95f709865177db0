"""The study of the hand-over: its table adds files up, and its page shows the end of the table."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from docs.drawings.hand_over import summary
from tests.benchmarks.study_hand_over import Training, table


def row(task: str, algorithm: str, seed: int, **returns: float) -> dict[str, Any]:
    speed = {"steps_per_second": 1000.0, "planner_ms": 0.1, "training": [(9, 3.0, 0)]}
    return {
        **Training(task, algorithm, seed, "", 5)._asdict(),
        **speed,
        **returns,
        "base": "lake",
        "point": 500,
        "alone": algorithm == "dqn",
    }


def test_the_table_pairs_the_seeds() -> None:
    rows = [row("lake", "dqn", seed, dqn=2.0 * seed) for seed in (0, 1)]
    for seed in (0, 1):
        rows.append(row("lake", "serp", seed, serp=9.0, planner=8.0, learner=9.0 + seed, random=0))
        rows.append(row("lake-dry", "serp", seed, serp=1.0, planner=1.0, learner=0.0))
    rng = np.random.default_rng(0)
    _, base, variant = table([rows[i] for i in rng.permutation(len(rows))])
    assert base[:4] == ["lake", "500", "2", "8 ± 0 (8)"]
    assert base[6:9] == ["1 ± 13 (0)", "-5 ± 64", "80 ± 130"]
    # The range is 0 ... 10, that of the base task; a baseline stands beside variants too.
    assert variant[6:9] == ["1 ± 13 (0)", "0 ± 0", "0 ± 130"]


def test_the_page_shows_the_end_of_both_tables() -> None:
    results = Path(__file__).parents[4] / "docs" / "results"
    page = (results / "hand-over.md").read_text(encoding="utf-8")
    for name in ("hand-over.csv", "hand-over-variants.csv"):
        with (results / name).open(newline="", encoding="utf-8") as file:
            assert "\n".join(summary(list(csv.DictReader(file)))) in page
