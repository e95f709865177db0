"""`serp why`."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from serp.runs.recording import open_recording
from tests.serp.ui.cli.conftest import Run


def explained(run: Run, *arguments: str) -> Any:
    return json.loads(run("why", *arguments, "--json").stdout)


def test_a_step_is_the_same_however_it_is_asked_for(run: Run, trained: Path) -> None:
    recording = open_recording(trained)
    step = int(recording.episodes[3][4])
    asked = str(trained), "--episode=3"
    shown = explained(run, str(trained), f"--step={step}")
    assert shown == explained(run, *asked, "--step=5")
    decision = recording.step(step).decision
    values = [each["best_return"] for each in shown["account"]["alternatives"]]
    assert values == decision.forecast.value.tolist()
    assert shown["executed"] == recording.layout.actions[decision.action]
    assert (shown["step"], shown["episode"], shown["number"]) == (step, 3, 5)
    run("evaluate", str(trained), "--episodes=1", "--seed=3")
    shown = explained(run, str(trained), "--evaluation=serp-seed3", "--step=0")
    assert (shown["step"], shown["episode"], shown["number"]) == (0, 1, 1)


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["--step=99999"], 1, "there is no step 99,999"),
        (["--episode=1"], 2, "give --step"),
    ],
)
def test_a_step_that_is_not_there_is_refused(
    arguments: list[str], status: int, said: str, run: Run, trained: Path
) -> None:
    assert said in run("why", str(trained), *arguments, expect=status).stderr


def test_a_run_without_a_recording_says_how_to_get_one(
    run: Run, trained: Path, tmp_path: Path
) -> None:
    shutil.copytree(trained, tmp_path / "old")
    shutil.rmtree(tmp_path / "old" / "recording")
    message = run("why", str(tmp_path / "old"), expect=1).stderr
    assert "serp evaluate" in message
