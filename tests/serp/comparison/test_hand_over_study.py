"""The study of the hand-over: its table adds files up."""

from __future__ import annotations

from typing import Any

import numpy as np

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


def test_the_table_pairs_the_seeds_and_shows_what_is_far_worse_in_bold() -> None:
    rows = [row("lake", "dqn", seed, dqn=2.0 * seed) for seed in (0, 1)]
    for seed in (0, 1):
        rows.append(row("lake", "serp", seed, serp=9.0, planner=8.0, learner=9.0 + seed, random=0))
        rows.append(row("lake-dry", "serp", seed, serp=1.0, planner=1.0, learner=0.0))
    rng = np.random.default_rng(0)
    _, _, base, variant = table([rows[i] for i in rng.permutation(len(rows))])
    cells = [cell.strip() for cell in base.split("|")[1:-1]]
    assert cells[:4] == ["lake", "500", "2", "8 ± 0 (8)"]
    assert cells[6:9] == ["1 ± 13 (0)", "-5 ± 64", "80 ± 130"]
    # The range is 0 ... 10, that of the base task; a baseline stands beside variants too.
    assert [cell.strip() for cell in variant.split("|")[7:10]] == [
        "1 ± 13 (0)",
        "0 ± 0",
        "0 ± 130",
    ]
    better = [row("lake", "serp", 0, serp=1.0, planner=8.0, learner=9.0, random=0)]
    assert "**-89**" in list(table(better))[-1]
