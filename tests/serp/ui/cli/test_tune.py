"""`serp tune`."""

from __future__ import annotations

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
