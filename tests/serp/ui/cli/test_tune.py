"""`serp tune`."""

from __future__ import annotations

import os
import signal
from typing import Any

import pytest

from serp.runs.comparison import workers
from tests.serp.ui.cli.conftest import Run

pytest.importorskip("optuna")
TUNE = [
    "tune", "--domain=cartpole", "--algorithm=dqn", "--vary=learner.guarded_targets",
    "--env-steps=60", "--trials=2", "--seeds=1", "--jobs=1", "--storage=s.db",
]  # fmt: skip


def test_the_end_shows_the_best_and_how_to_report_it(run: Run) -> None:
    result = run(*TUNE)
    assert "[2/2] learner.guarded_targets=" in result.stderr
    assert "best of 2: " in result.stdout and " as they were)" in result.stdout
    compare = "serp compare --domain cartpole --algorithms dqn:learner.guarded_targets="
    assert compare in result.stdout and ",dqn --seeds 10" in result.stdout
    assert "optuna-dashboard sqlite:///s.db" in result.stdout
    quiet = run(*TUNE, "--quiet")
    assert quiet.stdout in ("learner.guarded_targets=true\n", "learner.guarded_targets=false\n")
    assert quiet.stderr == ""


def test_ctrl_c_keeps_what_is_complete_and_says_how_to_go_on(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def pressing(jobs: Any, on_progress: Any, stopped: Any) -> Any:
        def pressed(trial: Any, steps: int) -> None:
            os.kill(os.getpid(), signal.SIGINT)
            on_progress(trial, steps)

        return workers.run_here(jobs, pressed, stopped)

    with monkeypatch.context() as patch:
        patch.setattr("serp.runs.tuning.run_here", pressing)
        stopped = run(*TUNE, expect=130)
    # The training that ran was finished, and with it its trial.
    assert "stopped after 1 of 2 trials, which are in sqlite:///s.db" in stopped.stderr
    assert "[2/2]" in run(*TUNE).stderr
