"""Append-only CSV tables: rows are collected in the step loop and formatted when flushed.

UTF-8, commas, a header line, one line per row. Floats are written so that they are read back
exactly; booleans as 0 and 1; None as an empty cell. Line breaks in text become blanks, so that each
line is a row and a truncated file only loses its last line. A failure of the disk is a `RunError`.
"""

from __future__ import annotations

import contextlib
import csv
import io
import os
import zlib
from collections.abc import Iterable, Sequence
from enum import Enum
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from serp._util.closing import Closing
from serp._util.files import cannot_write, open_regular
from serp.errors import RunError
from serp.runs.rows import LONGEST

_ROWS_HELD: Final = 1024  # formatted in about 5 ms, buffered in less than 1 MB
_BLOCK: Final = 65_536


class Position(NamedTuple):
    """A position in a table: the number of bytes before it, and their CRC-32."""

    bytes: int
    checksum: int


class Table(Closing):
    """Writes one CSV file with fixed columns.

    A missing or empty file is created with its header. Opening an existing one checks its header
    and drops an incomplete last line.

    Args:
        path: The file.
        columns: The names of its columns.
        added: Those that earlier versions did not write. A file of theirs goes on without them.
    """

    def __init__(self, path: Path, columns: Sequence[str], added: Sequence[str] = ()) -> None:
        self._path = path
        self._columns = tuple(columns)
        self._added = tuple(added)
        self._rows: list[Sequence[Any]] = []
        self._header = _lines([columns])
        self._written: list[int] | None = None  # positions of the columns; None: all of them
        try:
            file = open_regular(path, os.O_RDWR | os.O_CREAT | os.O_APPEND)
            self._file = os.fdopen(file, "r+b", buffering=0)
        except OSError as error:
            raise cannot_write(path, error, "The table is unchanged.") from error
        try:
            self._end = self._open_rows()
            self._checksum = self._checksum_of(self._end)
            if not self._end:
                self._write(self._header)
        except BaseException as error:
            self._file.close()
            if isinstance(error, OSError):
                raise cannot_write(path, error, "The table is unchanged.") from error
            raise

    def append(self, row: Sequence[Any]) -> None:
        """Add a row; it is written at the next `flush`, or when 1,024 rows are buffered.

        Its values, one per column, must not change afterwards.
        """
        if len(row) != len(self._columns):
            raise ValueError(
                f"{len(row)} values for the {len(self._columns)} columns of {self._path}"
            )
        self._rows.append(row if self._written is None else [row[k] for k in self._written])
        if len(self._rows) >= _ROWS_HELD:
            self.flush()

    def flush(self) -> None:
        """Write all buffered rows at once; after a failure they are still buffered."""
        if self._rows:
            self._write(_lines(self._rows))
            self._rows.clear()

    def sync(self) -> None:
        """Flush, and wait until the disk holds the rows."""
        self.flush()
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            raise cannot_write(self._path, error, "Its last rows may be missing.") from error

    def position(self) -> Position:
        """Flush, and return the end of the table, for `truncate`."""
        self.flush()
        return Position(self._end, self._checksum)

    def truncate(self, to: Position) -> None:
        """Go back to an earlier `position`: drop the rows after it, and buffered ones."""
        self._rows.clear()
        restore = "Restore the table from a copy, or begin a new run with another --out."
        if not len(self._header) <= to.bytes <= self._end:
            raise RunError(
                f"{self._path} has {self._end} bytes, and the checkpoint was made when it had "
                f"{to.bytes}: the table was truncated or changed since. {restore}"
            )
        try:
            if self._checksum_of(to.bytes) != to.checksum:
                raise RunError(
                    f"the rows of {self._path} up to byte {to.bytes} were changed after the "
                    f"checkpoint was made. {restore}"
                )
            self._file.truncate(to.bytes)
        except OSError as error:
            raise cannot_write(self._path, error, "The table is unchanged.") from error
        self._end, self._checksum = to

    def close(self) -> None:
        """Flush and close; a second call does nothing."""
        if self._file.closed:
            return
        try:
            self.flush()
        finally:
            self._file.close()

    def _open_rows(self) -> int:
        """Check the header, drop an incomplete last line, and return the end of the last row."""
        size = os.fstat(self._file.fileno()).st_size
        earlier = [k for k, name in enumerate(self._columns) if name not in self._added]
        header = _lines([[self._columns[k] for k in earlier]])
        found = self._file.read(len(self._header))
        if not self._header.startswith(found) and found.startswith(header):
            self._header, self._written, found = header, earlier, header
        if not self._header.startswith(found):
            raise RunError(
                f"{self._path}:1: has other columns than this serp writes "
                f"({', '.join(self._columns)}). Begin a new run with another --out."
            )
        end = 0  # of a file that is empty, or truncated inside its header
        if found == self._header:
            tail = max(0, size - LONGEST)
            self._file.seek(tail)
            end = tail + self._file.read(LONGEST).rfind(b"\n") + 1
            if end == tail:
                raise RunError(
                    f"{self._path} ends with a line of more than {LONGEST:,} bytes: it was changed "
                    "or damaged. Restore it from a copy, or begin a new run with another --out."
                )
        if end < size:
            self._file.truncate(end)
        return end

    def _checksum_of(self, size: int) -> int:
        """Return the CRC-32 of the first `size` bytes."""
        checksum = 0
        self._file.seek(0)
        for start in range(0, size, _BLOCK):
            checksum = zlib.crc32(self._file.read(min(_BLOCK, size - start)), checksum)
        return checksum

    def _write(self, data: bytes) -> None:
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except BaseException as error:
            # Remove a partial row: the next one would be appended to it.
            with contextlib.suppress(OSError):
                self._file.truncate(self._end)
            if not isinstance(error, OSError):
                raise
            kept = f"Its rows up to byte {self._end} are intact."
            raise cannot_write(self._path, error, kept) from error
        self._end += len(data)
        self._checksum = zlib.crc32(data, self._checksum)


def _lines(rows: Iterable[Sequence[Any]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(list(map(_cell, row)) for row in rows)
    return text.getvalue().encode("utf-8", "backslashreplace")


def _cell(value: Any) -> str | float | None:
    """Return a value of a row in a type that `csv` writes as the table promises."""
    if isinstance(value, np.generic):
        value = value.item()
    elif isinstance(value, Enum):
        value = value.value
    if isinstance(value, bool):
        return int(value)
    if value is None or isinstance(value, int | float):
        return value
    text = str(value)
    return " ".join(text.splitlines()) if "\n" in text or "\r" in text else text
