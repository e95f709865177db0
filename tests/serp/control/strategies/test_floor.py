"""What the file as written flags is a floor: real trainings, each decision judged by it again."""

from __future__ import annotations

from typing import Any

import pytest

from serp.tasks.registry import find_task
from tests.benchmarks.study_safety import train
from tests.serp import lava

SMALL: dict[str, Any] = {
    "learner": {"hidden": [16], "batch_size": 16, "members": 1, "symmetry": False},
}


@pytest.mark.parametrize(
    ("name", "steps", "changes"),
    [
        ("lava", 1_000, {}),
        ("lava", 500, {"planner": {"accepted_risk": 0.0}, "guide": {"strategy": "restrict"}}),
        ("cliff", 500, {}),
        ("soccer", 150, {}),
    ],
)
def test_nothing_that_the_file_flags_is_executed_while_it_leaves_anything_else(
    name: str, steps: int, changes: dict[str, Any]
) -> None:
    task = lava.task() if name == "lava" else find_task(name)
    counts = train(task.bind(), steps, 1, SMALL | changes)
    assert counts["decisions"] >= steps
    assert counts["avoidable"] == counts["avoidable risk"] == 0
