"""Append-only CSV tables: rows are collected in the step loop and formatted when flushed.

UTF-8, commas, a header line, one line per row. Floats are written so that they are read back
exactly; booleans as 0 and 1; None and NaN as an empty cell. Line breaks in text become blanks, so
that each line is a row and a truncated file only loses its last line. A failure of the disk is a
`RunError`.
"""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import itertools
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any, Final, NamedTuple, get_type_hints

import numpy as np

from serp._util.files import Closing, cannot_write, open_regular, read_regular
from serp.agent.decision import Decision
from serp.errors import RunError


class MetricsRow(NamedTuple):
    """One episode: a row of ``metrics.csv``, see docs/reference/run-folder.md; None: no cell."""

    episode: int
    env_steps: int
    return_: float
    domain_return: float | None
    length: int
    terminated: bool
    truncated: bool
    rho: float | None
    epsilon: float | None
    planner_steps: int
    learner_steps: int
    exploration_steps: int
    fallback_steps: int
    vetoes: int
    unsafe_predicted: int
    unsafe_executed: int
    avoidable_unsafe: int
    unsafe_observed: int
    no_safe_action: int
    saw_all: int
    by_cells: int
    cut_short: int
    safety_alone: int
    layers_seen: int
    indifferent: int
    loss: float | None
    wall_time: float


class DecisionRow(NamedTuple):
    """One decision: a row of ``decisions.csv``; the reason is a `Reason`."""

    step: int
    episode: int
    proposed_by: str
    proposed: str
    executed: str
    executed_by: str
    reason: str
    vetoed: bool
    predicted_reward: float | None
    proposal_unsafe: bool
    unsafe: bool
    risk: float | None
    rho: float | None
    depth: int
    bound: str
    indifferent: bool


def decision_row(
    decision: Decision, name: Callable[[int], str], *, step: int, episode: int
) -> DecisionRow:
    """Return the row of a decision; `name` gives the name of an action of the environment."""
    proposed_by, executed_by, *rest = _of_decision(decision)
    proposed = name(decision.proposed) if decision.proposed >= 0 else ""
    executed = name(decision.action)
    return DecisionRow(step, episode, proposed_by, proposed, executed, executed_by, *rest)


_OWN: Final = ("step", "episode", "proposed", "executed")
_of_decision: Final = attrgetter(  # in one call, so fast
    *(name for name in DecisionRow._fields if name not in _OWN)
)


def _columns(row: type[NamedTuple]) -> tuple[str, ...]:
    # `return` is a keyword of Python, so the field has an underscore and the column has none.
    return tuple(field.rstrip("_") for field in row._fields)


METRICS_COLUMNS = _columns(MetricsRow)
DECISIONS_COLUMNS = _columns(DecisionRow)


class Table(Closing):
    """Writes one CSV file with fixed columns; it is made with its header, if it is missing.

    Of the rows that it holds, so many are kept.

    Raises:
        RunError: It has other columns, or the disk fails.
    """

    def __init__(self, path: Path, columns: Sequence[str], rows: int = 0) -> None:
        self._path, self._size, self._digest = path, 0, hashlib.sha256()
        self._columns = tuple(columns)
        self._rows: list[Sequence[Any]] = []
        with self._or_refused("The table is unchanged."), contextlib.ExitStack() as stack:
            file = open_regular(path, os.O_RDWR | os.O_CREAT | os.O_APPEND)
            self._file = stack.enter_context(os.fdopen(file, "r+b", buffering=0))
            end = self._end_of(rows)
            self._file.truncate(end)
            if not end:
                self._rows.append(self._columns)
                self.flush()
            stack.pop_all()

    @contextlib.contextmanager
    def _or_refused(self, kept: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise cannot_write(self._path, error, kept) from error

    def _end_of(self, rows: int) -> int:
        """Return the number of bytes up to the end of a row; 0 for a file without a header."""
        header = _lines([self._columns])
        end = 0
        with open(self._file.fileno(), "rb", closefd=False) as file:
            for line in itertools.islice(file, 1 + rows):
                if not end and not header.startswith(line):
                    raise RunError(
                        f"{self._path}:1: the columns are not those of this version of serp "
                        f"({', '.join(self._columns)}). Begin a new run with another --out."
                    )
                if line.endswith(b"\n"):
                    end += len(line)
                    self._digest.update(line)
        self._size = end
        return end

    def append(self, row: Sequence[Any]) -> None:
        """Add a row; it is written at the next `flush`, or when 1,024 rows are buffered.

        Its values, one per column, must not change afterwards.
        """
        self._rows.append(row)
        if len(self._rows) >= 1024:
            self.flush()

    def flush(self) -> None:
        """Write all buffered rows at once; after a failure they are still buffered."""
        if not self._rows:
            return
        lines = _lines(self._rows)
        rest = memoryview(lines)
        end = self._file.seek(0, os.SEEK_END)
        with self._or_refused(f"Its rows up to byte {end} are intact."):
            try:
                while rest:
                    rest = rest[self._file.write(rest) :]
            except BaseException:
                # Remove a partial row: the next one would be appended to it.
                with contextlib.suppress(OSError):
                    self._file.truncate(end)
                raise
        self._size += len(lines)
        self._digest.update(lines)
        self._rows.clear()

    def written(self) -> dict[str, Any]:
        """Return the size of what was flushed, and its SHA-256."""
        return {"bytes": self._size, "sha256": self._digest.hexdigest()}

    def sync(self) -> None:
        """Flush, and wait until the disk holds the rows."""
        self.flush()
        with self._or_refused("Its last rows may be missing."):
            os.fsync(self._file.fileno())

    def close(self) -> None:
        """Flush and close; a second call does nothing."""
        if not self._file.closed:
            with self._file:
                self.flush()


def _lines(rows: Iterable[Sequence[Any]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(list(map(_cell, row)) for row in rows)
    return text.getvalue().encode("utf-8", "backslashreplace")


def _cell(value: Any) -> str | float | None:
    """Return a value of a row in a type that `csv` writes as the table promises."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool):
        return int(value)
    if value is None or isinstance(value, int | float):
        return value if value == value else None
    text = str(value)
    return " ".join(text.splitlines()) if "\n" in text or "\r" in text else text


_CELLS: Final[Mapping[Any, tuple[Callable[[str], float], str]]] = {
    int: (lambda cell: int(np.int64(cell)), "a 64-bit whole number"),
    bool: ({"0": False, "1": True}.__getitem__, "0 or 1"),
    float: (lambda cell: float(cell or "nan"), "a number"),
}
"""Type of a column → what reads a cell of it, and what a cell must be."""


def read_metrics(path: Path) -> dict[str, np.ndarray[Any, Any]]:
    """Read ``metrics.csv``: column → array ``[episodes]``.

    Counts are int64, flags bool, everything else float64 with NaN for an empty cell. A last line
    without a line break is incomplete (the run was killed, or is writing) and is left out.
    """

    def malformed(number: int, why: str) -> RunError:
        return RunError(
            f"{path}:{number}: {why}. The file was changed or damaged; restore it from a copy."
        )

    lines = read_regular(path).decode("utf-8", "backslashreplace").split("\n")
    header, *rows = [line.rstrip("\r").split(",") for line in lines[:-1] or lines]
    if tuple(header) != METRICS_COLUMNS:
        raise RunError(
            f"{path}:1: the columns are not {', '.join(METRICS_COLUMNS)}. Another version of "
            "serp, or another program, has written this file."
        )
    hints = get_type_hints(MetricsRow)
    kinds = [hints[field] if hints[field] in _CELLS else float for field in MetricsRow._fields]
    columns: list[list[float]] = [[] for _ in kinds]
    for number, cells in enumerate(rows, start=2):
        if len(cells) != len(kinds):
            raise malformed(number, f"{len(cells)} cells where the header has {len(kinds)}")
        for name, kind, cell, column in zip(header, kinds, cells, columns, strict=True):
            read, wanted = _CELLS[kind]
            try:
                column.append(read(cell))
            except (KeyError, ValueError, OverflowError):
                raise malformed(number, f"{name} is {cell!r}; it must be {wanted}") from None
    return {
        name: np.array(column, kind)
        for name, kind, column in zip(METRICS_COLUMNS, kinds, columns, strict=True)
    }
