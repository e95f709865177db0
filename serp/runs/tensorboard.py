"""TensorBoard event files of a run."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path
from typing import Any

from serp._util.closing import Closing
from serp.errors import MissingExtra, RunError
from serp.runs.rows import METRICS_COLUMNS, MetricsRow


def require_tensorboard() -> None:
    """Check that TensorBoard is installed."""
    if importlib.util.find_spec("tensorboard") is None:
        raise MissingExtra("writing TensorBoard events", "tensorboard")


class EventWriter(Closing):
    """Writes every number of an episode's metrics as a scalar over env steps. A context manager.

    Args:
        folder: The run; events go to `tensorboard/` in it. A continued run appends to them.
        purge_step: Number of env steps from which a continued run discards earlier events.
    """

    def __init__(self, folder: Path, purge_step: int | None = None) -> None:
        require_tensorboard()
        events = folder / "tensorboard"
        if events.is_symlink():
            raise RunError(f"{events} is a link. Put a folder there, or remove it.")
        from torch.utils.tensorboard import SummaryWriter

        self._writer: Any = SummaryWriter(str(events), purge_step=purge_step)

    def append(self, row: MetricsRow) -> None:
        """Write the metrics of one episode."""
        for name, value in zip(METRICS_COLUMNS, row, strict=True):
            if name != "env_steps" and value is not None and math.isfinite(value):
                self._writer.add_scalar(f"episode/{name}", float(value), row.env_steps)

    def flush(self) -> None:
        """Flush all events to the disk."""
        self._writer.flush()

    def close(self) -> None:
        """Close the event file."""
        self._writer.close()
