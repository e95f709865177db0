"""Files are replaced in one step; links, pipes and folders in a run are refused."""

import contextlib
import os
import sys

import numpy as np
import pytest

from serp._util.files import aside_of, write_durably, write_together
from serp.errors import RunError
from serp.runs.checkpoint import CHECKPOINT, save
from serp.runs.folder import DECISIONS, LOCK, METRICS, SUMMARY
from serp.runs.run import Run
from serp.runs.tables import DECISIONS_COLUMNS, METRICS_COLUMNS, Table, read_metrics
from tests.serp.runs.test_folder import create

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no such files there")

READ = ["config.json", "domain.pddl", METRICS, DECISIONS, CHECKPOINT, LOCK]
WRITTEN = [SUMMARY, f"{SUMMARY}.aside", f"{CHECKPOINT}.aside"]
TABLES = {METRICS: METRICS_COLUMNS, DECISIONS: DECISIONS_COLUMNS}
KINDS = {
    "link": lambda path, target: path.symlink_to(target),
    "relative link": lambda path, target: path.symlink_to(f"../{target.name}"),
    "dangling link": lambda path, target: path.symlink_to(target.with_name("nowhere")),
    "link to itself": lambda path, target: path.symlink_to(path),
    "link to a device": lambda path, target: path.symlink_to("/dev/zero"),
    "hard link": lambda path, target: path.hardlink_to(target),
    "pipe": lambda path, target: os.mkfifo(path),
    "folder": lambda path, target: path.mkdir(),
}


def use(path):
    """Everything that is done with a run."""
    with Run(path).lock() as run:
        _ = run.model
        for name, columns in TABLES.items():
            Table(path / name, columns).close()
        save(path / CHECKPOINT, {"x": np.arange(3)}, {})
        write_durably(path / SUMMARY, '{"episodes": 1}')
        _ = run.summary
        read_metrics(path / METRICS)


@pytest.mark.parametrize("kind", KINDS)
def test_no_file_outside_of_a_run_is_read_waited_for_or_written(tmp_path, kind):
    secret = tmp_path / "secret"
    for name in [*READ, *WRITTEN]:
        path = tmp_path / f"run-{name}"
        with create(path) as run:
            save(path / CHECKPOINT, {}, {"made_of": run.digests()})
        for table, columns in TABLES.items():
            Table(path / table, columns).close()
        original = path / name
        content = original.read_bytes() if original.exists() else b"{}"
        original.unlink(missing_ok=True)
        secret.write_bytes(content)
        KINDS[kind](original, secret)
        # What is only read may have another name; what is written aside replaces what was there.
        harmless = name in WRITTEN and kind != "folder"
        harmless |= kind == "hard link" and name not in (METRICS, DECISIONS, LOCK)
        expected = contextlib.nullcontext() if harmless else pytest.raises(RunError, match=name)
        with expected:
            use(path)
        assert secret.read_bytes() == content, name
        assert sorted(os.listdir(tmp_path)) == sorted(["secret", path.name]), name
        secret.unlink()
        path.rename(tmp_path.parent / f"{tmp_path.name}-{path.name}")


def test_a_file_is_replaced_and_nothing_else_is_changed_or_left(tmp_path):
    """Neither what a killed process left aside, nor the target of a link."""
    target, path = tmp_path / "target", tmp_path / "x"
    target.write_text("old")
    path.symlink_to(target)
    aside_of(path).symlink_to(target)
    before = os.umask(0o027)
    try:
        write_durably(path, "größer \udc80")
    finally:
        os.umask(before)
    assert path.read_bytes() == "größer \\udc80".encode()
    assert path.lstat().st_mode & 0o777 == 0o640
    assert target.read_text() == "old"
    assert sorted(os.listdir(tmp_path)) == ["target", "x"]
    with pytest.raises(
        RunError,
        match=r"summary\.json: No such file or directory\. summary.json did not exist before",
    ):
        write_durably(tmp_path / "gone" / "summary.json", "x")


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
