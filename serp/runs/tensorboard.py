"""TensorBoard event files of a run."""

from __future__ import annotations

import importlib.util
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from serp._util.files import Closing
from serp.agent.decision import Actor
from serp.agent.step_record import StepRecord
from serp.errors import MissingExtra, RunError
from serp.runs.tables import METRICS_COLUMNS, MetricsRow


def require_tensorboard() -> None:
    """Check that TensorBoard is installed."""
    if importlib.util.find_spec("tensorboard") is None:
        raise MissingExtra("writing TensorBoard events", "tensorboard")


class EventWriter(Closing):
    """Writes numbers of a training as scalars over env steps. A context manager.

    All numbers of an episode, or of a step, are one event: a scalar at a time costs many times as
    much.

    Args:
        folder: The run; events go to `tensorboard/` in it. A continued run appends to them.
        purge_step: Number of env steps from which a continued run discards earlier events.
    """

    def __init__(self, folder: Path, purge_step: int | None = None) -> None:
        require_tensorboard()
        events = folder / "tensorboard"
        if events.is_symlink():
            raise RunError(f"{events} is a link. Put a folder there, or remove it.")
        from tensorboard.compat.proto.event_pb2 import Event, SessionLog
        from tensorboard.compat.proto.summary_pb2 import Summary
        from tensorboard.summary.writer.event_file_writer import EventFileWriter

        self._summary: Any = Summary
        self._event: Any = Event
        self._writer: Any = EventFileWriter(str(events))
        if purge_step is not None:
            begun = SessionLog(status=SessionLog.START)
            self._write(purge_step, session_log=begun)

    def append(self, row: MetricsRow) -> None:
        """Write the metrics of one episode."""
        numbers = dict(zip(METRICS_COLUMNS, row, strict=True))
        del numbers["env_steps"]
        self._add("episode", numbers, row.env_steps)

    def append_step(self, env_steps: int, step: StepRecord) -> None:
        """Write the numbers of one env step; `env_steps` counts it."""
        decision = step.decision
        numbers = {
            "reward": step.reward,
            "env_reward": step.env_reward,
            "domain_reward": step.domain_reward,
            "predicted_reward": decision.predicted_reward,
            "unsafe": step.unsafe_observed,
            "vetoed": decision.vetoed,
            "planner": decision.executed_by is Actor.PLANNER,
            "rho": decision.rho,
        }
        self._add("step", numbers, env_steps)

    def _add(self, group: str, numbers: Mapping[str, float | None], env_steps: int) -> None:
        value = self._summary.Value
        values = [
            value(tag=f"{group}/{name}", simple_value=float(number))
            for name, number in numbers.items()
            if number is not None and math.isfinite(number)
        ]
        self._write(env_steps, summary=self._summary(value=values))

    def _write(self, env_steps: int, **content: Any) -> None:
        self._writer.add_event(self._event(step=env_steps, wall_time=time.time(), **content))

    def flush(self) -> None:
        """Flush all events to the disk."""
        self._writer.flush()

    def close(self) -> None:
        """Close the event file."""
        self._writer.close()
