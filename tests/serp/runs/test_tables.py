"""Tables: what is written is read back, row by row, wherever the file or the process ended."""

import csv
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.errors import RunError
from serp.runs.tables import METRICS_COLUMNS, MetricsRow, Table, read_metrics

COLUMNS = ("a", "b", "c")
ROW = MetricsRow(
    1, 23, 1 / 3, -0.0, 23, True, False, 0.01, None, 20, 1, 1, 1, 1, 1, 0, 0, 2, 0, 5, 1, 2, 4,
    54, 3, None, 0.25,
)  # fmt: skip


def cells(path):
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.reader(file))[1:]


def write(path, rows, columns=COLUMNS, kept=0):
    with Table(path, columns, kept) as table:
        for row in rows:
            table.append(row)


# Writing -----------------------------------------------------------------------------------------


@given(rows=st.lists(st.tuples(st.floats(), st.integers(), st.text() | st.none()), max_size=20))
@settings(max_examples=100, deadline=None)
def test_floats_come_back_exactly_and_every_line_is_a_row(tmp_path_factory, rows):
    path = tmp_path_factory.getbasetemp() / "table.csv"
    path.unlink(missing_ok=True)
    write(path, rows)
    assert path.read_bytes().count(b"\n") == len(rows) + 1
    for row, found in zip(rows, cells(path), strict=True):
        bits = np.float64(found[0]).tobytes() if found[0] else None
        assert bits == (None if row[0] != row[0] else np.float64(row[0]).tobytes())
        assert int(found[1]) == row[1]
        if row[2] is not None and not {"\n", "\r"} & set(row[2]):
            assert found[2] == row[2].encode("utf-8", "backslashreplace").decode()


# Continuing --------------------------------------------------------------------------------------


_FILL_THE_DISK = """
import resource, sys
from pathlib import Path
from serp.errors import RunError
from serp.runs.tables import Table
soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
table = Table(Path(sys.argv[1]), ("a", "b", "c"))
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


def test_a_table_that_was_changed_since_is_refused(tmp_path):
    path = tmp_path / "t"
    write(path, [(step, "x", None) for step in range(3)])
    whole = path.read_bytes()
    with pytest.raises(
        RunError, match=r"t:1: the columns are not those of this version of serp \(a, d\)"
    ):
        write(path, [], columns=("a", "d"))
    assert path.read_bytes() == whole


@pytest.mark.parametrize("kept", range(4))
def test_rows_are_kept_and_what_was_written_after_them_is_removed(tmp_path, kept):
    path = tmp_path / "t"
    write(path, [(step, "x", None) for step in range(3)])
    path.write_bytes(path.read_bytes() + b"3,x")  # half a row, of a process that was killed
    write(path, [("new", "", None)], kept=kept)
    assert [row[0] for row in cells(path)] == [*map(str, range(kept)), "new"]


# Reading -----------------------------------------------------------------------------------------


def test_wherever_the_file_is_cut_all_whole_rows_are_read_whatever_the_line_ends(tmp_path):
    write(tmp_path / "m", [ROW._replace(episode=e) for e in range(1, 4)], METRICS_COLUMNS)
    whole = (tmp_path / "m").read_bytes()
    header = whole.index(b"\n") + 1
    for length in range(header, len(whole)):
        (tmp_path / "m").write_bytes(whole[:length])
        expected = whole[:length].count(b"\n") - 1
        metrics = read_metrics(tmp_path / "m")
        assert metrics["episode"].tolist() == [1, 2, 3][:expected]
        assert metrics["episode"].dtype == np.int64 and metrics["rho"].dtype == np.float64
    (tmp_path / "m").write_bytes(whole.replace(b"\n", b"\r\n"))
    assert read_metrics(tmp_path / "m")["episode"].tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"\n2,", b"\n,", r"m:3: episode is ''; it must be a 64-bit whole"),
        (b"\n2,", b"\n99999999999999999999,", r"m:3: episode is .* 64-bit"),
        (b"\n2,", b"\n2,2,", r"m:3: 28 cells where the header has 27"),
        (b"\n2,23,", b"\n2,\xff,", r"m:3: env_steps is .* 64-bit"),
        (b",1,0,0.01,", b",yes,0,0.01,", r"m:2: terminated is 'yes'; it must be 0 or 1"),
        (b",0,0.01,", b",0,0.0.1,", r"m:2: rho is '0\.0\.1'; it must be a number"),
        (b"episode,", b"epsiode,", r"m:1: the columns are not episode, env_steps"),
    ],
)
def test_malformed_rows_are_named_by_file_and_line(tmp_path, old, new, message):
    path = tmp_path / "m"
    write(path, [ROW._replace(episode=e) for e in range(1, 4)], METRICS_COLUMNS)
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new, 1))
    with pytest.raises(RunError, match=message):
        read_metrics(path)
