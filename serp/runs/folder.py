"""The run folder, which one process at a time writes and any process reads.

``config.json``             resolved configuration, seed, command, versions, machine
``domain.pddl``             copy of the domain (and ``problem.pddl``, if there is one)
``planner-1.pddl``, …       copies of the domains of the task's own planners (and their problems)
``metrics.csv``             one row per episode
``decisions.csv``           one row per decision
``recording``               every step in numbers, see `serp.runs.recording_format`
``checkpoint.safetensors``  the newest training state, and ``checkpoint-previous.safetensors``
``summary.json``, ``report.md``, ``learning-curve.png``, ``learning-curve.svg``  the results

What cannot be read or written is a `RunError`.
"""

from __future__ import annotations

import contextlib
import datetime
import json
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from serp._util.closing import Closing
from serp._util.files import aside_of, cannot_write, require_regular, sync_folder, write_durably
from serp._util.json_files import read_json
from serp._util.saved_state import Saved
from serp.errors import RunError
from serp.model.loading import problem_beside
from serp.runs.checkpoint import DAMAGED, NEWEST, Checkpoint, load_newest, save_rotating
from serp.runs.config import CONFIG, config_text, read_config
from serp.runs.lock import RunLock
from serp.runs.new_folder import make_empty, occupied
from serp.runs.rows import DECISIONS_COLUMNS, METRICS_ADDED, METRICS_COLUMNS
from serp.runs.tables import Position, Table

METRICS: Final = "metrics.csv"
DECISIONS: Final = "decisions.csv"
SUMMARY: Final = "summary.json"
_COPY: Final = re.compile(r"(domain|problem|planner-[0-9]+(-problem)?)\.pddl")
_TABLES: Final = {METRICS: (METRICS_COLUMNS, METRICS_ADDED), DECISIONS: (DECISIONS_COLUMNS, ())}
_POSITIONS: Final = "tables"  # the key of the table positions in a checkpoint's JSON
Texts = Sequence[tuple[str, str]]
"""Name and text of a domain file and, if there is one, of its problem file."""


def is_trace(name: str) -> bool:
    """Return whether a file may be what a run left that was stopped before its beginning.

    ``config.json`` is none: it is written last, and makes the folder a run.
    """
    written = name.removesuffix(aside_of(Path("x")).suffix)
    return bool(_COPY.fullmatch(written)) or written in _TABLES or written == CONFIG != name


def _copies(number: int) -> tuple[str, str]:
    """Return the names of a domain's copy and of its problem's; 0 is the task's own."""
    if number:
        return f"planner-{number}.pddl", f"planner-{number}-problem.pddl"
    return "domain.pddl", "problem.pddl"


class RunFolder(Closing):
    """The files of a run; `create` or `open` returns one. A context manager.

    Attributes:
        path: The folder.
        metadata: The content of ``config.json``.
    """

    def __init__(self, path: Path, metadata: dict[str, Any], lock: RunLock | None) -> None:
        self.path = path
        self.metadata = metadata
        self._lock = lock
        self._tables: dict[str, Table] = {}
        if lock is not None:
            try:
                for name, (columns, added) in _TABLES.items():
                    self._tables[name] = Table(path / name, columns, added)
            except BaseException:
                self.close()
                raise

    @classmethod
    def create(
        cls,
        path: Path | str,
        config: Mapping[str, Any],
        domain_files: Texts,
        *,
        planners: Sequence[Texts] = (),
        command: Sequence[str] = (),
        now: datetime.datetime | None = None,
    ) -> RunFolder:
        """Begin a run in a new or empty folder, and lock it for writing.

        After a failure, the run can be begun again in the same folder.

        Args:
            path: The folder; its parents are created.
            config: The resolved configuration, JSON values (also paths, enums and NumPy scalars);
                its ``seed`` is repeated at the top level of ``config.json``.
            domain_files: The task's own domain.
            planners: The domains of its planners; they are numbered from 1.
            command: The command line.
            now: The time of the beginning.
        """
        path = Path(path)
        copies = {
            copy: file
            for number, files in enumerate((domain_files, *planners))
            for copy, file in zip(_copies(number), files, strict=False)
        }
        names = {copy: name for copy, (name, _) in copies.items()}
        text = config_text(config, names, command, now or datetime.datetime.now())
        make_empty(path, is_trace)
        run = cls(path, json.loads(text), RunLock(path))
        try:
            # Another process may have begun a run since the folder was checked.
            if os.path.lexists(path / CONFIG):
                raise occupied(path)
            for file in path.iterdir():  # of a run that was stopped before its beginning
                if _COPY.fullmatch(file.name) and file.name not in copies:
                    file.unlink()
            for copy, (_, content) in copies.items():
                write_durably(path / copy, content.encode())
            write_durably(path / CONFIG, text)  # last, because it makes the folder a run
        except BaseException:
            run.close()
            raise
        return run

    @classmethod
    def open(cls, path: Path | str, *, writing: bool = False) -> RunFolder:
        """Open an existing run; to continue it (`writing`), lock it and open its tables."""
        path = Path(path)
        return cls(path, read_config(path), RunLock(path) if writing else None)

    @property
    def config(self) -> dict[str, Any]:
        """The resolved configuration that `create` was given."""
        config: dict[str, Any] = self.metadata["config"]
        return config

    def copies(self, number: int = 0) -> tuple[Path, Path | None]:
        """Return the copies of a domain and of its problem, None if it has none.

        Number 0 is the task's own domain; those of its planners count from 1.
        """
        domain, problem = _copies(number)
        file = require_regular(self.path / domain)
        require_regular(problem_beside(file))  # perhaps not written by serp, but it would be loaded
        if problem not in self.metadata["domain_files"]:
            return file, None
        return file, require_regular(self.path / problem)

    @property
    def metrics(self) -> Table:
        """The metrics, one `MetricsRow` per episode, of a run open for writing."""
        return self._table(METRICS)

    @property
    def decisions(self) -> Table:
        """The decision log, one `DecisionRow` per step, of a run open for writing."""
        return self._table(DECISIONS)

    def flush(self) -> None:
        """Flush all rows of both tables to the disk."""
        self.metrics.sync()
        self.decisions.sync()

    def save_checkpoint(
        self, arrays: Mapping[str, np.ndarray[Any, Any]], meta: Mapping[str, Any]
    ) -> Path:
        """Flush both tables, then save a checkpoint with their positions."""
        self.flush()
        ends = {name: table.position() for name, table in self._tables.items()}
        return save_rotating(self.path, arrays, {**meta, _POSITIONS: ends})

    def load_checkpoint(self) -> Checkpoint:
        """Read the newest intact checkpoint.

        Its `fallback` is set if the previous one was read. A run open for writing then renames the
        damaged one to ``checkpoint-damaged.safetensors``, so that the next save does not keep it as
        the previous one.
        """
        found = load_newest(self.path)
        newest = self.path / NEWEST
        if self._lock is not None and found.path != newest and newest.exists():
            try:
                os.replace(newest, self.path / DAMAGED)
                sync_folder(self.path)
            except OSError as error:
                kept = "The previous checkpoint is intact."
                raise cannot_write(self.path / DAMAGED, error, kept) from error
        return found

    def resume(self) -> Checkpoint:
        """Return the newest intact checkpoint; truncate both tables to the positions in it."""
        found = self.load_checkpoint()
        saved = Saved("run", {}, found.meta.pop(_POSITIONS, None))
        ends = {name: Position(*saved.wholes(name, 2)) for name in _TABLES}
        for name, end in ends.items():
            self._table(name).truncate(end)
        return found

    def write(self, name: str, content: str | bytes) -> Path:
        """Write a file of the run atomically and durably."""
        if self._lock is None:
            raise self._read_only()
        write_durably(self.path / name, content)
        return self.path / name

    def read_summary(self) -> dict[str, Any]:
        """Read ``summary.json``."""
        return read_json(self.path / SUMMARY, "It is written when the run ends.")

    def close(self) -> None:
        """Flush and close the tables and release the lock; a second call does nothing."""
        with contextlib.ExitStack() as stack:
            if self._lock is not None:
                stack.callback(self._lock.release)
            for table in self._tables.values():
                stack.callback(table.close)
            self._lock, self._tables = None, {}

    def _table(self, name: str) -> Table:
        if name not in self._tables:
            raise self._read_only()
        return self._tables[name]

    def _read_only(self) -> RunError:
        return RunError(f"the run {self.path} is not open for writing.")
