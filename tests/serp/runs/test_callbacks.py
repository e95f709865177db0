"""Functions of the user see a training, and cannot spoil it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from serp.agent.step_record import StepRecord
from serp.errors import SettingsError
from serp.runs.tables import MetricsRow
from serp.runs.train import plan_and_learn
from tests.serp.runs.runs import everything, resume, rows, train
from tests.serp.sample_tasks import corridor


def test_callbacks_see_every_step_and_episode_and_change_nothing(tmp_path: Path) -> None:
    rewards: list[float] = []
    seen: list[MetricsRow] = []
    train(corridor(tmp_path), tmp_path / "alone", episodes=3)
    train(
        corridor(tmp_path), tmp_path / "seen", episodes=3,
        on_step=lambda step: rewards.append(step.env_reward), on_episode=seen.append,
    )  # fmt: skip
    assert everything(tmp_path / "seen") == everything(tmp_path / "alone")
    table = rows(tmp_path / "seen", "metrics")
    assert [str(row.return_) for row in seen] == [row["return"] for row in table]
    assert len(rewards) == seen[-1].env_steps


def test_one_that_fails_ends_the_run_after_the_episode_and_it_goes_on(tmp_path: Path) -> None:
    calls: list[int] = []

    def fails(step: StepRecord) -> None:
        calls.append(step.number)
        if len(calls) == 4:
            raise ZeroDivisionError("mine")

    task, out = corridor(tmp_path), tmp_path / "run"
    train(task, tmp_path / "whole", episodes=5)
    with pytest.raises(ZeroDivisionError, match="mine") as failure:
        train(task, out, episodes=5, on_step=fails)
    assert len(calls) == 4
    assert "resume=True" in "".join(failure.value.__notes__)
    assert len(rows(out, "metrics")) == 1
    resume(task, out, episodes=5, on_episode=lambda row: None)
    assert everything(out)[:3] == everything(tmp_path / "whole")[:3]


def test_wrong_callbacks_are_refused_before_anything_is_made(tmp_path: Path) -> None:
    task: Any = corridor(tmp_path)
    wrong: Any = {"on_step": 3}
    with pytest.raises(SettingsError, match="on_step must be a function of one argument, not 3"):
        plan_and_learn(task, out=tmp_path / "run", **wrong)
    assert not (tmp_path / "run").exists()
