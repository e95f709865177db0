"""Append-only CSV tables: rows are collected in the step loop and formatted when flushed.

UTF-8, commas, a header line, one line per row. Floats are written by `repr`, so that they are read
back exactly; booleans as 0 and 1; None as an empty cell. Text is quoted if necessary; its line
breaks become blanks, so that each line is a row and a truncated file only loses its last line.
"""

from __future__ import annotations

import contextlib
import os
import zlib
from collections.abc import Callable, Iterable, Sequence
from enum import Enum
from pathlib import Path
from types import NoneType
from typing import Any, Final, NamedTuple

import numpy as np

from serp._util.closing import Closing
from serp._util.files import cannot_write, open_regular, write_all
from serp.errors import RunError
from serp.runs.rows import LONGEST

_ROWS_HELD: Final = 1024  # formatted in about 5 ms, buffered in less than 1 MB
_BLOCK: Final = 65_536


class Position(NamedTuple):
    """A position in a table, with a checksum of the bytes before it.

    Attributes:
        bytes: Number of bytes before it.
        checksum: Their CRC-32.
    """

    bytes: int
    checksum: int


class Table(Closing):
    """Writes one CSV file with fixed columns.

    Opening an existing file checks its header and drops an incomplete last line.

    Args:
        path: The file; it is created with its header if it is missing or empty.
        columns: Names of the columns.

    Raises:
        RunError: The file cannot be opened or written, or has other columns.
    """

    def __init__(self, path: Path | str, columns: Sequence[str]) -> None:
        self.path = Path(path)
        self.columns = tuple(columns)
        self._width = len(self.columns)
        self._rows: list[Sequence[Any]] = []
        self._header = (",".join(map(_text, self.columns)) + "\n").encode()
        try:
            self._file = open_regular(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND)
        except OSError as error:
            raise cannot_write(self.path, error, "The table is unchanged.") from error
        self._open = True
        self._checksum: int | None = None  # computed from the file when first needed
        try:
            self._end = os.fstat(self._file).st_size
            self._check()
        except BaseException:
            self._close()
            raise

    def append(self, row: Sequence[Any]) -> None:
        """Add a row; it is written at the next `flush`, or when 1,024 rows are buffered.

        Args:
            row: One value per column, in order; they must not change afterwards.

        Raises:
            ValueError: The number of values is not that of the columns.
            RunError: The buffered rows could not be written; they are still buffered.
        """
        if len(row) != self._width:
            raise ValueError(
                f"{len(row)} values for the {len(self.columns)} columns of {self.path}"
            )
        rows = self._rows
        rows.append(row)
        if len(rows) >= _ROWS_HELD:
            self.flush()

    def flush(self) -> None:
        """Write all buffered rows at once.

        Raises:
            RunError: The write failed. The file ends with the last row before this write, and
                the rows are still buffered, so that a later flush can write them.
        """
        if not self._rows:
            return
        columns = [_format(values) for values in zip(*self._rows, strict=True)]
        lines = [*map(",".join, zip(*columns, strict=True)), ""]
        self._write("\n".join(lines).encode("utf-8", "backslashreplace"))
        self._rows.clear()

    def sync(self) -> None:
        """Flush, and wait until the disk holds the rows.

        Raises:
            RunError: The write failed.
        """
        self.flush()
        try:
            os.fsync(self._file)
        except OSError as error:
            raise cannot_write(self.path, error, "Its last rows may be missing.") from error

    def position(self) -> Position:
        """Flush, and return the end of the table, for `truncate`.

        Raises:
            RunError: The write failed.
        """
        self.flush()
        if self._checksum is None:
            try:
                self._checksum = self._checksum_of(self._end)
            except OSError as error:
                raise RunError(f"cannot read {self.path}: {error.strerror or error}.") from error
        return Position(self._end, self._checksum)

    def truncate(self, to: Position) -> None:
        """Go back to an earlier `position`: drop the rows after it, and buffered ones.

        Raises:
            RunError: The file is shorter, its rows up to the position were changed, or the disk
                failed.
        """
        self._rows.clear()
        position = to.bytes
        if not len(self._header) <= position <= self._end:
            raise RunError(
                f"{self.path} has {self._end} bytes, and the checkpoint was made when it had "
                f"{position}: the table was truncated or changed since. Restore it from a copy, or "
                "begin a new run with another --out."
            )
        try:
            if self._checksum_of(position) != to.checksum:
                raise RunError(
                    f"the rows of {self.path} up to byte {position} were changed after the "
                    "checkpoint was made. Restore the table from a copy, or begin a new run with "
                    "another --out."
                )
            os.ftruncate(self._file, position)
        except OSError as error:
            raise cannot_write(self.path, error, "The table is unchanged.") from error
        self._end, self._checksum = position, to.checksum

    def close(self) -> None:
        """Flush and close; a second call does nothing.

        Raises:
            RunError: The write failed; the file is closed nevertheless.
        """
        if not self._open:
            return
        try:
            self.flush()
        finally:
            self._close()

    def _close(self) -> None:
        self._open = False
        os.close(self._file)

    def _check(self) -> None:
        """Write the header of a new file, or check that of an old one and drop a partial line."""
        try:
            found = self._read(0, len(self._header))
            if found == self._header:
                whole = self._end_of_last_line()
                if whole < self._end:
                    os.ftruncate(self._file, whole)
                    self._end = whole
                return
            # An empty file, or one truncated inside its header.
            if not self._header.startswith(found):
                raise RunError(
                    f"{self.path}:1: has other columns than this serp writes "
                    f"({', '.join(self.columns)}). Begin a new run with another --out."
                )
            if found:
                os.ftruncate(self._file, 0)
                self._end = 0
        except OSError as error:
            raise cannot_write(self.path, error, "The table is unchanged.") from error
        self._write(self._header)

    def _end_of_last_line(self) -> int:
        end = self._end
        while end > 0:
            start = max(0, end - _BLOCK)
            newline = self._read(start, end - start).rfind(b"\n")
            if newline >= 0:
                return start + newline + 1
            if self._end - start > LONGEST:
                raise RunError(
                    f"{self.path} ends with a line of more than {LONGEST:,} bytes: it was changed "
                    "or damaged. Restore it from a copy, or begin a new run with another --out."
                )
            end = start
        return 0

    def _read(self, start: int, size: int) -> bytes:
        """Return at most `size` bytes from `start`, none beyond the end of the written rows."""
        size = min(size, self._end - start)
        os.lseek(self._file, start, os.SEEK_SET)
        return os.read(self._file, size) if size > 0 else b""

    def _checksum_of(self, size: int) -> int:
        """Return the CRC-32 of the first `size` bytes."""
        checksum = 0
        for start in range(0, size, _BLOCK):
            checksum = zlib.crc32(self._read(start, min(_BLOCK, size - start)), checksum)
        return checksum

    def _write(self, data: bytes) -> None:
        try:
            write_all(self._file, data)
        except BaseException as error:
            # Remove a partial row: the next one would be appended to it.
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self._end)
            if not isinstance(error, OSError):
                raise
            kept = f"Its rows up to byte {self._end} are intact."
            raise cannot_write(self.path, error, kept) from error
        if self._end == 0:
            self._checksum = 0
        self._end += len(data)
        if self._checksum is not None:
            self._checksum = zlib.crc32(data, self._checksum)


def _text(value: str) -> str:
    if "\n" in value or "\r" in value:
        value = " ".join(value.splitlines())
    if '"' in value:
        return '"' + value.replace('"', '""') + '"'
    return f'"{value}"' if "," in value else value


def _format(values: Sequence[Any]) -> Iterable[str]:
    """Return the cells of one column; formatting by columns is twice as fast as by rows."""
    kinds = set(map(type, values))
    if len(kinds) > 1:
        return [_FORMATS.get(type(value), _other)(value) for value in values]
    (kind,) = kinds
    if issubclass(kind, str):  # names, reasons and enums, which repeat often
        texts = values if kind is str else list(map(str.__str__, values))
        cells = {text: _text(text) for text in set(texts)}
        return map(cells.__getitem__, texts)
    return map(_FORMATS.get(kind, _other), values)


def _other(value: Any) -> str:
    """Format a NumPy scalar, an enum or any other object."""
    if isinstance(value, np.generic):
        value = value.item()
    elif isinstance(value, Enum):
        value = value.value
    elif isinstance(value, float):
        return float.__repr__(value)
    elif isinstance(value, int):
        return int.__repr__(value)
    known = _FORMATS.get(type(value))
    return known(value) if known else _text(str(value))


_FORMATS: Final[dict[type, Callable[[Any], str]]] = {
    bool: {False: "0", True: "1"}.__getitem__,
    int: int.__repr__,
    float: float.__repr__,
    str: _text,
    NoneType: lambda _: "",
}
