"""TensorBoard event files of a run."""

from __future__ import annotations

import importlib.util
import math
import time
from pathlib import Path
from typing import Any

from serp._util.files import Closing
from serp.errors import MissingExtra, RunError
from serp.runs.tables import METRICS_COLUMNS, MetricsRow


def require_tensorboard() -> None:
    """Check that TensorBoard is installed."""
    if importlib.util.find_spec("tensorboard") is None:
        raise MissingExtra("writing TensorBoard events", "tensorboard")


class EventWriter(Closing):
    """Writes numbers of a training as scalars over env steps. A context manager.

    All numbers of an episode are one event: a scalar at a time costs many times as much.

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
        value = self._summary.Value
        values = [
            value(tag=f"episode/{name}", simple_value=float(number))
            for name, number in zip(METRICS_COLUMNS, row, strict=True)
            if name != "env_steps" and number is not None and math.isfinite(number)
        ]
        self._write(row.env_steps, summary=self._summary(value=values))

    def _write(self, env_steps: int, **content: Any) -> None:
        self._writer.add_event(self._event(step=env_steps, wall_time=time.time(), **content))

    def flush(self) -> None:
        """Flush all events to the disk."""
        self._writer.flush()

    def close(self) -> None:
        """Close the event file."""
        self._writer.close()
