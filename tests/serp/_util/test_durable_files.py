from __future__ import annotations

import os
import subprocess
import sys

import pytest

from serp._util.durable_files import aside_of, write_durably, write_together
from serp.errors import RunError


def test_replaces_the_file_and_leaves_nothing_else(tmp_path):
    path = tmp_path / "summary.json"
    write_durably(path, "old")
    write_durably(path, "größer")
    assert path.read_bytes() == "größer".encode()
    assert os.listdir(tmp_path) == ["summary.json"]


def test_what_a_killed_process_left_aside_is_cleared_away(tmp_path):
    path = tmp_path / "summary.json"
    aside_of(path).write_text("half of")
    write_durably(path, b"whole")
    assert os.listdir(tmp_path) == ["summary.json"]
    assert path.read_bytes() == b"whole"


def test_text_that_is_no_unicode_is_still_written(tmp_path):
    write_durably(tmp_path / "x", "a\udc80b")
    assert (tmp_path / "x").read_bytes() == b"a\\udc80b"


def test_failure_says_why_and_where(tmp_path):
    with pytest.raises(RunError, match=r"summary\.json: No such file or directory\. No summary"):
        write_durably(tmp_path / "gone" / "summary.json", "x")


def test_file_permissions_follow_the_umask(tmp_path):
    before = os.umask(0o027)
    try:
        write_durably(tmp_path / "x", "x")
    finally:
        os.umask(before)
    assert (tmp_path / "x").stat().st_mode & 0o777 == 0o640


_WRITE_TOO_MUCH = """
import resource, sys
from pathlib import Path
from serp.errors import RunError
from serp._util.durable_files import write_durably
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
try:
    write_durably(Path(sys.argv[1]), b"x" * 5000)
except RunError as error:
    print(error)
"""


def test_write_that_fails_half_way_keeps_the_former_file(tmp_path):
    path = tmp_path / "report.md"
    path.write_text("former")
    done = subprocess.run(
        [sys.executable, "-c", _WRITE_TOO_MUCH, str(path)], capture_output=True, text=True
    )
    assert "File too large" in done.stdout and "The former report.md is kept whole" in done.stdout
    assert path.read_text() == "former"
    assert os.listdir(tmp_path) == ["report.md"]


def test_several_files_are_replaced_together_or_not_at_all(tmp_path):
    one, two = tmp_path / "one", tmp_path / "two"
    write_together({one: "old", two: "old"})
    for other in (tmp_path / "gone" / "x", tmp_path):
        with pytest.raises(RunError, match="cannot write"):
            write_together({one: "new", other: "new", two: "new"})
    assert [one.read_text(), two.read_text()] == ["old", "old"]
    assert sorted(os.listdir(tmp_path)) == ["one", "two"]
    write_together({one: "new", two: "newer"})
    assert [one.read_text(), two.read_text()] == ["new", "newer"]
