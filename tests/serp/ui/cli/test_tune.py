"""`serp tune`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.serp.ui.cli.conftest import Run

pytest.importorskip("optuna")
TUNE = [
    "tune", "--domain=cartpole", "--algorithm=dqn", "--vary=learner.guarded_targets",
    "--env-steps=60", "--trials=2", "--seeds=1", "--jobs=1", "--out=s",
]  # fmt: skip


def test_the_end_shows_the_best_and_how_to_report_it(run: Run) -> None:
    result = run(*TUNE)
    assert "[2/2] learner.guarded_targets=" in result.stderr
    assert "best of 2: " in result.stdout and " as they were)" in result.stdout
    compare = "serp compare --domain cartpole --algorithms dqn:learner.guarded_targets="
    assert compare in result.stdout and ",dqn --seeds 10" in result.stdout
    assert "optuna-dashboard s/study.log" in result.stdout
    quiet = run(*TUNE, "--quiet")
    assert quiet.stdout in ("learner.guarded_targets=true\n", "learner.guarded_targets=false\n")
    assert quiet.stderr == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--vary=planner.depth=2..3"], "give --domain (`serp list` names the tasks) or --task"),
        (["--domain=cartpole"], "Missing option '--vary'"),
        (["--domain=cartpole", "--vary=a.b", "--vary=a.b=1,2"], "a setting is given twice"),
    ],
)
def test_usage_errors(arguments: list[str], message: str, run: Run) -> None:
    assert message in run("tune", *arguments, expect=2).stderr
    assert list(Path().iterdir()) == []
