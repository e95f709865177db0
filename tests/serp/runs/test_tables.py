from __future__ import annotations

import math
import os
import subprocess
import sys
from enum import Enum, StrEnum
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.errors import RunError
from serp.runs.reading import read_rows
from serp.runs.tables import Position, Table

COLUMNS = ("a", "b", "c")


def cells(path, columns=COLUMNS):
    return [row for _, row in read_rows(path, columns)]


class Who(StrEnum):
    PLANNER = "planner"


class Level(Enum):
    HIGH = 3


class Slow:
    def __str__(self):
        return "told, late"


@pytest.mark.parametrize(
    ("value", "cell"),
    [
        (True, "1"),
        (False, "0"),
        (np.True_, "1"),
        (None, ""),
        (3, "3"),
        (-(2**70), str(-(2**70))),
        (np.int64(3), "3"),
        (0.1, "0.1"),
        (np.float64(0.1), "0.1"),
        (np.float32(0.1), "0.10000000149011612"),
        (-0.0, "-0.0"),
        (1e300, "1e+300"),
        (math.inf, "inf"),
        (math.nan, "nan"),
        ("plain", "plain"),
        ('a "b", c', 'a "b", c'),
        ("two\nlines\r\nmore", "two lines more"),
        ("größer ρ", "größer ρ"),
        (Who.PLANNER, "planner"),
        (Level.HIGH, "3"),
        (Slow(), "told, late"),
    ],
)
def test_values_are_written_as_the_table_promises(tmp_path, value, cell):
    with Table(tmp_path / "t", COLUMNS) as table:
        table.append((value, value, 1))
        table.append((value, "other", 2))  # a column of one kind, and one of several
    assert cells(tmp_path / "t") == [[cell, cell, "1"], [cell, "other", "2"]]


@given(rows=st.lists(st.tuples(st.floats(), st.integers(), st.text() | st.none()), max_size=20))
@settings(max_examples=100, deadline=None)
def test_floats_come_back_exactly_and_every_line_is_a_row(tmp_path_factory, rows):
    path = tmp_path_factory.getbasetemp() / "table.csv"
    path.unlink(missing_ok=True)
    with Table(path, COLUMNS) as table:
        for row in rows:
            table.append(row)
    assert path.read_bytes().count(b"\n") == len(rows) + 1
    read = cells(path)
    assert len(read) == len(rows)
    for row, found in zip(rows, read, strict=True):
        assert np.float64(found[0]).tobytes() == np.float64(row[0]).tobytes() or row[0] != row[0]
        assert int(found[1]) == row[1]
        if row[2] is not None and not {"\n", "\r"} & set(row[2]):
            assert found[2] == row[2].encode("utf-8", "backslashreplace").decode()


def test_nothing_is_written_before_the_flush_and_everything_after(tmp_path):
    table = Table(tmp_path / "t", COLUMNS)
    table.append((1, 2, 3))
    assert cells(tmp_path / "t") == []
    table.flush()
    assert cells(tmp_path / "t") == [["1", "2", "3"]]
    for step in range(10_000):
        table.append((step, step, step))
    assert len(cells(tmp_path / "t")) > 8_000  # as many are held as fit into a small buffer
    table.close()
    table.close()
    assert len(cells(tmp_path / "t")) == 10_001


def test_rows_of_another_width_are_refused(tmp_path):
    with Table(tmp_path / "t", COLUMNS) as table, pytest.raises(ValueError, match="3 columns"):
        table.append((1, 2))


def test_truncate_and_write_again_equals_writing_once(tmp_path):
    def write(table, steps):
        for step in steps:
            table.append((step, step / 7, f"ρ{step}"))

    with Table(tmp_path / "once", COLUMNS) as table:
        write(table, range(30))
    with Table(tmp_path / "twice", COLUMNS) as table:
        write(table, range(10))
        position = table.position()
        write(table, range(10, 25))
    with Table(tmp_path / "twice", COLUMNS) as table:
        table.append((99, 99, 99))
        table.truncate(position)
        write(table, range(10, 30))
    assert (tmp_path / "once").read_bytes() == (tmp_path / "twice").read_bytes()


@pytest.mark.parametrize("position", [0, 3, 10_000])
def test_truncating_to_where_the_table_never_was_is_refused(tmp_path, position):
    with Table(tmp_path / "t", COLUMNS) as table:
        table.append((1, 2, 3))
        table.flush()
        with pytest.raises(RunError, match="the table was truncated or changed"):
            table.truncate(Position(position, 0))


@pytest.mark.parametrize("reopened", [False, True])
def test_rows_that_were_changed_since_are_refused(tmp_path, reopened):
    path = tmp_path / "t"
    with Table(path, COLUMNS) as table:
        for step in range(1000):
            table.append((step, "x" * 90, None))
        position = table.position()
        for _ in range(10):
            table.append((1, 2, 3))
    if reopened:
        with Table(path, COLUMNS) as table:
            assert table.position() != position
            table.truncate(position)
            assert table.position() == position
    content = path.read_bytes()
    for place in (20, 70_000, position.bytes - 3):
        path.write_bytes(content[:place] + b"7" + content[place + 1 :])
        with (
            Table(path, COLUMNS) as table,
            pytest.raises(RunError, match="were changed after the checkpoint"),
        ):
            table.truncate(position)


@pytest.mark.parametrize("tail", [b"4,5", b'4,"5', b"\0\0\0\0", b"x" * 200_000])
def test_reopening_drops_a_cut_last_line(tmp_path, tail):
    path = tmp_path / "t"
    with Table(path, COLUMNS) as table:
        table.append((1, 2, 3))
    with open(path, "ab") as file:
        file.write(tail)
    assert cells(path) == [["1", "2", "3"]]  # reading leaves it out as well
    with Table(path, COLUMNS) as table:
        table.append((7, 8, 9))
    assert cells(path) == [["1", "2", "3"], ["7", "8", "9"]]


def test_header_that_was_cut_is_written_anew(tmp_path):
    (tmp_path / "t").write_bytes(b"a,b")
    with Table(tmp_path / "t", COLUMNS) as table:
        table.append((1, 2, 3))
    assert cells(tmp_path / "t") == [["1", "2", "3"]]


def test_file_with_other_columns_is_left_alone(tmp_path):
    (tmp_path / "t").write_bytes(b"a,b\n1,2\n")
    with pytest.raises(RunError, match=r"t:1: has other columns"):
        Table(tmp_path / "t", COLUMNS)
    assert (tmp_path / "t").read_bytes() == b"a,b\n1,2\n"


_FILL_THE_DISK = """
import resource, sys
from serp.errors import RunError
from serp.runs.tables import Table
soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
table = Table(sys.argv[1], ("a", "b", "c"))
table.append((1, 2, 3))
table.flush()
for step in range(500):
    table.append(("x" * 10, step, step))
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
try:
    table.flush()
except RunError as error:
    print(error)
with open(sys.argv[1]) as file:
    print(file.read().count("x"))
resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
table.close()
"""


def test_write_that_fails_half_way_leaves_whole_rows_and_can_be_done_again(tmp_path):
    path = tmp_path / "t"
    done = subprocess.run(
        [sys.executable, "-c", _FILL_THE_DISK, str(path)], capture_output=True, text=True
    )
    message, rows_then = done.stdout.splitlines()
    assert "File too large. Its rows up to byte" in message
    assert rows_then == "0"  # not half of the rows
    assert len(cells(path)) == 501  # nothing was lost once there was room again


def test_no_file_stays_open_when_opening_fails(tmp_path):
    (tmp_path / "t").write_bytes(b"other\n")
    before = len(os.listdir("/dev/fd")) if Path("/dev/fd").exists() else 0
    for _ in range(5):
        with pytest.raises(RunError):
            Table(tmp_path / "t", COLUMNS)
    assert before in (0, len(os.listdir("/dev/fd")))
