"""Recording the steps of a run, or of an evaluation, in blocks."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from serp._util.closing import Closing
from serp._util.files import make_inside, write_durably
from serp.control.step_record import StepRecord
from serp.errors import Notice, RunError
from serp.runs.lock import RunLock
from serp.runs.recording_format import (
    COLUMNS,
    EVALUATIONS,
    HEADER,
    Columns,
    Layout,
    block_path,
    blocks_in,
    decode,
    encode,
    enter,
)


@contextlib.contextmanager
def recorded_evaluation(run: Path, name: str, layout: Layout) -> Iterator[Recorder | None]:
    """Yield the recorder of an evaluation of a run, in place of an earlier one of that name.

    Where the folder of the run cannot be written, nothing is recorded, and a notice says so.

    Args:
        run: The folder of the run.
        name: Name of the evaluation, such as `serp-seed0`.
        layout: What is recorded.
    """
    with contextlib.ExitStack() as stack:
        recorder: Recorder | None = None
        try:
            folder = make_inside(run, EVALUATIONS, name)
            stack.callback(RunLock(folder).release)
            recorder = stack.enter_context(Recorder(folder, layout))
        except (RunError, OSError) as error:
            warnings.warn(f"the episodes are not recorded: {error}", Notice, stacklevel=3)
        yield recorder


class Recorder(Closing):
    """Writes the steps of a recording, one after another. A context manager.

    Steps are written where a block is full, at `flush` and at `close`. Only the last block is ever
    written again.

    Args:
        folder: The folder of the recording; it is made.
        layout: What is recorded.
        steps: Steps to keep of what has been recorded there; the rest is removed.

    Raises:
        RunError: There are fewer steps, they are of another layout, or the disk fails.
    """

    def __init__(self, folder: Path, layout: Layout, steps: int = 0) -> None:
        make_inside(folder.parent, folder.name)
        self._folder = folder
        self._layout = layout
        self._number, rest = divmod(steps, layout.block)
        self._columns: Columns = layout.empty(layout.block)
        self._final = np.zeros((layout.block, len(layout.fluents)))
        self._ends = self._rows = 0
        self._written = True
        if steps:
            self._keep(steps)
        for number, file in blocks_in(folder).items():
            if number > self._number or (number == self._number and not rest):
                file.unlink()
        write_durably(folder / HEADER, layout.text())

    def _keep(self, steps: int) -> None:
        """Take over the steps that are there."""
        number, row = divmod(steps - 1, self._layout.block)
        rows = row + 1
        if Layout.read(self._folder) != self._layout:
            raise RunError(
                f"{self._folder / HEADER} is not of this run: names or sizes differ. Restore it "
                "from a copy, or begin a new run with another --out."
            )
        there = blocks_in(self._folder)
        last = decode(there[number], self._layout) if number in there else None
        found = 0 if last is None else len(last["number"])
        if sum(k < number for k in there) < number or last is None or found < rows:
            raise RunError(
                f"{self._folder} does not hold the {steps:,} steps that the run has made: blocks "
                "are missing. Restore them from a copy, or begin a new run with another --out."
            )
        if rows == self._layout.block:
            return
        ends = (last["terminated"] | last["truncated"])[:rows]
        self._ends, self._rows = int(ends.sum()), rows
        self._final[: self._ends] = last.pop("final_state")[: self._ends]
        for name, values in last.items():
            self._columns[name][:rows] = values[:rows]

    def append(self, episode: int, step: StepRecord) -> None:
        """Add a step; nothing of it is kept that may change afterwards.

        Args:
            episode: Number of the episode, from 1.
            step: The step.
        """
        enter(self._columns, self._rows, episode, step)
        if step.last:
            self._final[self._ends] = step.next_state
            self._ends += 1
        self._rows += 1
        self._written = False
        if self._rows == self._layout.block:
            self.flush()
            self._number, self._rows, self._ends = self._number + 1, 0, 0

    def flush(self) -> None:
        """Write the steps of the last block."""
        if self._written:
            return
        last = {
            name: self._columns[name][: self._rows] for name in COLUMNS if name != "final_state"
        }
        last["final_state"] = self._final[: self._ends]
        write_durably(block_path(self._folder, self._number), encode(last))
        self._written = True

    def close(self) -> None:
        """Write what is left; a second call does nothing."""
        self.flush()
