"""Reads a run's CSV tables; what is malformed is a `RunError` that names the line."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_type_hints

import numpy as np

from serp._util.files import open_regular
from serp.control.decision_counts import DecisionCounts
from serp.errors import RunError
from serp.runs.rows import (
    DECISIONS_COLUMNS,
    LONGEST,
    METRICS_ADDED,
    METRICS_COLUMNS,
    MetricsRow,
)


def read_rows(
    path: Path, columns: Sequence[str], added: Sequence[str] = ()
) -> Iterator[tuple[int, list[str]]]:
    """Yield line number (from 1; the header is line 1) and cells of every complete row.

    A last line without a line break is incomplete (the run was killed, or is writing) and is left
    out. A file that lacks the columns `added`, which earlier versions did not write, has empty
    cells there.
    """
    number, found = 0, list(columns)
    try:
        with os.fdopen(open_regular(path, os.O_RDONLY), "rb") as file:
            for number, line in enumerate(iter(lambda: file.readline(LONGEST), b""), start=1):
                if len(line) == LONGEST:
                    raise _malformed(path, number, f"longer than {LONGEST:,} bytes")
                if number > 1 and not line.endswith(b"\n"):
                    break
                cells = _cells(path, number, line)
                if number == 1:
                    found = cells
                    if found not in (list(columns), [c for c in columns if c not in added]):
                        raise RunError(
                            f"{path}:1: the columns are not {', '.join(columns)}. Was this file "
                            "written by serp, of this version?"
                        )
                elif len(cells) != len(found):
                    raise _malformed(
                        path, number, f"{len(cells)} cells where the header has {len(found)}"
                    )
                else:
                    if len(found) < len(columns):
                        row = dict(zip(found, cells, strict=True))
                        cells = [row.get(name, "") for name in columns]
                    yield number, cells
    except OSError as error:
        raise RunError(f"cannot read {path}: {error.strerror or error}.") from error
    if number == 0:
        raise RunError(f"{path} is empty; it should begin with a header.")


def read_metrics(path: Path) -> dict[str, np.ndarray[Any, Any]]:
    """Read ``metrics.csv``: column → array ``[episodes]``.

    Counts are int64, flags bool, everything else float64 with NaN for an empty cell.
    """
    hints = get_type_hints(MetricsRow)
    kinds = {field.rstrip("_"): hints[field] for field in MetricsRow._fields}
    columns: dict[str, list[float]] = {name: [] for name in METRICS_COLUMNS}
    for number, cells in read_rows(path, METRICS_COLUMNS, METRICS_ADDED):
        for name, cell in zip(METRICS_COLUMNS, cells, strict=True):
            columns[name].append(_parse(path, number, name, kinds[name], cell))
    return {
        name: np.array(column, kinds[name] if kinds[name] in (int, bool) else float)
        for name, column in columns.items()
    }


def count_decisions(path: Path) -> DecisionCounts:
    """Count the decisions of ``decisions.csv``."""
    tally = DecisionCounts()
    for number, cells in read_rows(path, DECISIONS_COLUMNS):
        row = dict(zip(DECISIONS_COLUMNS, cells, strict=True))
        flags = {
            name: bool(_parse(path, number, name, bool, row[name]))
            for name in ("vetoed", "proposal_unsafe", "unsafe", "indifferent")
        }
        depth = int(_parse(path, number, "depth", int, row["depth"]))
        tally.count(SimpleNamespace(**(row | flags | {"depth": depth})))
    return tally


def _parse(path: Path, number: int, name: str, kind: Any, cell: str) -> float:
    try:
        if kind is bool:
            return {"0": False, "1": True}[cell]
        if kind is int:
            return int(np.int64(cell))
        return float(cell) if cell else math.nan
    except (KeyError, ValueError, OverflowError):
        wanted = {bool: "0 or 1", int: "a whole number of 64 bits"}.get(kind, "a number")
        raise _malformed(path, number, f"{name} is {cell!r}; it must be {wanted}") from None


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
