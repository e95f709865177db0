"""Reads a run's CSV tables; errors name the line."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, get_type_hints

import numpy as np

from serp._util.files import open_regular
from serp.control.decision_counts import DecisionCounts
from serp.errors import RunError
from serp.runs.rows import DECISIONS_COLUMNS, LONGEST, METRICS_COLUMNS, MetricsRow

_INT64: Final = range(-(2**63), 2**63)


def read_rows(path: Path | str, columns: Sequence[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield line number (from 1; the header is line 1) and cells of every complete row.

    A last line without a line break is incomplete (the run was killed, or is writing) and is left
    out.

    Raises:
        RunError: The file cannot be read, has other columns, or a row is malformed.
    """
    path = Path(path)
    number = 0
    try:
        with os.fdopen(open_regular(path, os.O_RDONLY), "rb") as file:
            for number, line in enumerate(iter(lambda: file.readline(LONGEST), b""), start=1):
                if len(line) == LONGEST:
                    raise _malformed(path, number, f"longer than {LONGEST:,} bytes")
                if number > 1 and not line.endswith(b"\n"):
                    break
                cells = _cells(path, number, line)
                if number == 1:
                    if cells != list(columns):
                        raise RunError(
                            f"{path}:1: the columns are not {', '.join(columns)}. Was this file "
                            "written by serp, of this version?"
                        )
                elif len(cells) != len(columns):
                    raise _malformed(
                        path, number, f"{len(cells)} cells where the header has {len(columns)}"
                    )
                else:
                    yield number, cells
    except OSError as error:
        raise RunError(f"cannot read {path}: {error.strerror or error}.") from error
    if number == 0:
        raise RunError(f"{path} is empty; it should begin with a header.")


def read_metrics(path: Path | str) -> dict[str, np.ndarray[Any, Any]]:
    """Read ``metrics.csv``: column → array ``[episodes]``.

    Counts are int64, flags bool, everything else float64 with NaN for an empty cell.

    Raises:
        RunError: See `read_rows`; also for a cell that is not a number.
    """
    hints = get_type_hints(MetricsRow)
    kinds = [hints[field] for field in MetricsRow._fields]
    columns: list[list[Any]] = [[] for _ in kinds]
    for number, cells in read_rows(path, METRICS_COLUMNS):
        for name, kind, column, cell in zip(METRICS_COLUMNS, kinds, columns, cells, strict=True):
            try:
                column.append(_parse(kind, cell))
            except ValueError as error:
                raise _malformed(Path(path), number, f"{name} is {cell!r}; {error}") from None
    return {
        name: np.array(column, dtype=kind if kind in (int, bool) else float)
        for name, kind, column in zip(METRICS_COLUMNS, kinds, columns, strict=True)
    }


class _Counted(NamedTuple):
    """The columns of ``decisions.csv`` that are counted."""

    executed_by: str
    reason: str
    vetoed: bool
    proposal_unsafe: bool
    unsafe: bool


def count_decisions(path: Path | str) -> DecisionCounts:
    """Count the decisions of ``decisions.csv``.

    Raises:
        RunError: See `read_rows`; also for a cell that is not 0 or 1.
    """
    tally = DecisionCounts()
    kinds = get_type_hints(_Counted)
    places = [(name, DECISIONS_COLUMNS.index(name), kinds[name]) for name in _Counted._fields]
    for number, cells in read_rows(path, DECISIONS_COLUMNS):
        values: list[Any] = []
        for name, place, kind in places:
            try:
                values.append(cells[place] if kind is str else _parse(kind, cells[place]))
            except ValueError as error:
                raise _malformed(
                    Path(path), number, f"{name} is {cells[place]!r}; {error}"
                ) from None
        tally.count(_Counted(*values))
    return tally


def _parse(kind: Any, cell: str) -> float:
    if kind is bool:
        if cell not in ("0", "1"):
            raise ValueError("it must be 0 or 1")
        return cell == "1"
    if kind is int:
        try:
            value = int(cell)
        except ValueError:
            raise ValueError("it must be a whole number") from None
        if value not in _INT64:
            raise ValueError("it must fit into 64 bits")
        return value
    if not cell:
        return float("nan")
    try:
        return float(cell)
    except ValueError:
        raise ValueError("it must be a number") from None


def _cells(path: Path, number: int, line: bytes) -> list[str]:
    try:
        text = line.decode("utf-8").rstrip("\r\n")
        return next(csv.reader([text], strict=True), [])
    except UnicodeDecodeError:
        raise _malformed(path, number, "not UTF-8") from None
    except csv.Error as error:
        raise _malformed(path, number, str(error)) from None


def _malformed(path: Path, number: int, why: str) -> RunError:
    return RunError(
        f"{path}:{number}: {why}. The file was changed or damaged; restore it from a copy."
    )
