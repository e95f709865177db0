"""An environment that does not come back is reported while it hangs."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

from serp.runs.rollout import Watchdog
from serp.tasks.task import BoundTask
from tests.serp.sample_tasks import Corridor, corridor


class Hanging(Corridor):
    """Hangs in a call until somebody lets it go."""

    def __init__(self) -> None:
        super().__init__()
        self.go = threading.Event()

    def reset(self, **options: Any) -> Any:
        assert self.go.wait(20)
        return super().reset(**options)

    def step(self, action: int) -> Any:
        assert self.go.wait(20)
        return super().step(action)


def bound(folder: Path) -> tuple[BoundTask, threading.Event]:
    task = corridor(folder, Hanging).bind()
    assert isinstance(task.env, Hanging)
    return task, task.env.go


def test_a_call_that_takes_long_is_said_while_it_hangs_and_once(tmp_path: Path) -> None:
    task, go = bound(tmp_path)
    said: list[str] = []

    def say(line: str) -> None:
        said.append(line)
        go.set()  # only now does the environment come back

    with Watchdog(task, 0.05, lambda: 1234, say):
        task.reset(seed=0)
        go.clear()
        threading.Timer(0.3, go.set).start()
        task.step(1)
    assert task.call is None
    (line,) = said
    assert "not returned for 0.05 s: reset, env step 1,234" in line
