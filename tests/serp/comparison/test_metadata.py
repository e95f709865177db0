"""What is recorded of a comparison beside its numbers."""

from __future__ import annotations

import shlex
from importlib.metadata import version
from pathlib import Path

import pytest

from serp.comparison.metadata import machine, rerun_command, versions
from serp.comparison.trial_records import Trial
from tests.serp.comparison.test_plan import plan


def test_versions_and_machine_are_those_of_this_process() -> None:
    found = versions()
    assert found["numpy"] == version("numpy")
    assert None not in found.values()
    assert "core" in machine() and "," in machine()


@pytest.mark.parametrize(("seeds", "text"), [([1, 0], "0-1"), ([4], "4-4"), ([1, 7], "1,7")])
def test_the_command_names_all_that_is_no_default(
    tmp_path: Path, seeds: list[int], text: str
) -> None:
    changes = {"arbiter": {"r_min": None}, "learner": {"hidden": (8, 8), "members": 1}}
    trials = [Trial("serp", "walk", seed) for seed in seeds]
    made = plan(tmp_path, changes=changes, trials=trials, threshold=2.5, max_ground_schemas=70_000)
    command = rerun_command(made, None)
    for part in (
        f"--seeds {text} ", "--domain domains/walk.pddl", "--task FILE.py:FUNCTION",
        "--algorithms serp,dqn", "--env-steps 130", "--evaluate-every 50", "--threshold 2.5",
        "--evaluation-episodes 3", "--final-episodes 4", "--max-ground-schemas 70000",
        "--set arbiter.r_min=null", "--set learner.members=1",
    ):  # fmt: skip
        assert part in command
    assert "learner.hidden=[8, 8]" in shlex.split(command)
    assert "--threshold" not in rerun_command(made, 2.5)
