from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from serp.errors import RunError
from serp.runs.checkpoint import DAMAGED, NEWEST, PREVIOUS
from serp.runs.folder import DECISIONS, METRICS, RunFolder
from serp.runs.reading import read_metrics
from serp.runs.rows import DecisionRow, MetricsRow

CONFIG = {"seed": 3, "domain": "cartpole", "settings": {"r_min": "-inf", "layers": (64, 64)}}
DOMAIN = ("cartpole.pddl", "(define (domain cartpole))")


def metrics_row(episode):
    return MetricsRow(
        episode, 10 * episode, 10.0, 9.0, 10, True, False, 0.1, 0.2, 5, 3, 1, 1, 1, 1, 0, 0, 0.5, 1
    )


def decision_row(step):
    return DecisionRow(
        step, 1, "planner", "l", "l", "planner", "turn", False, 0.1, False, False, 0.0, 0.5, ""
    )


def create(path, **more):
    return RunFolder.create(path, CONFIG, [DOMAIN], **more)


def about(**other):
    """A ``config.json`` in which one thing is another."""
    whole = {
        "format": 2, "created": "2026-11-21T04:05:06+00:00", "command": ["serp"], "seed": 1,
        "domain_files": {"domain.pddl": "d.pddl"}, "config": {}, "versions": {}, "machine": {},
    }  # fmt: skip
    return json.dumps(whole | other)


def snapshot(path):
    return {file.name: file.read_bytes() for file in path.iterdir() if file.is_file()}


def test_a_new_run_holds_what_is_needed_to_repeat_it(tmp_path):
    problem = ("some-problem.pddl", "(define (problem p))\r\n")
    path = tmp_path / "runs" / "x"
    command = ["serp", "plan-and-learn", "--domain", "cartpole"]
    with RunFolder.create(path, CONFIG, [DOMAIN, problem], command=command) as run:
        opened = RunFolder.open(path)
        assert opened.config == run.config
    assert opened.config["settings"] == {"r_min": "-inf", "layers": [64, 64]}
    assert (opened.domain_file.read_text(), opened.problem_file) == (
        DOMAIN[1],
        path / "problem.pddl",
    )
    assert (path / "domain.pddl").read_text() == DOMAIN[1]
    assert (path / "problem.pddl").read_bytes() == problem[1].encode()
    about = json.loads((path / "config.json").read_text())
    assert about["command"] == command
    assert about["seed"] == 3
    assert about["domain_files"] == {"domain.pddl": DOMAIN[0], "problem.pddl": problem[0]}
    assert about["versions"]["numpy"] == np.__version__
    for name in ("serp", "torch", "gymnasium", "numba", "unified-planning"):
        assert name in about["versions"]
    assert about["machine"]["python"].endswith(sys.version.split()[0])
    assert about["machine"]["platform"]


def test_a_run_is_begun_in_an_empty_folder_and_once_only(tmp_path):
    create(tmp_path).close()
    before = snapshot(tmp_path)
    with pytest.raises(RunError, match=r"already holds a run.*--resume.*--out"):
        create(tmp_path)
    assert snapshot(tmp_path) == before


def test_a_file_in_the_place_of_the_folder_is_left_alone(tmp_path):
    (tmp_path / "x").write_text("text")
    with pytest.raises(RunError, match="is a file"):
        create(tmp_path / "x")
    with pytest.raises(RunError, match=r"cannot write .*Not a directory"):
        create(tmp_path / "x" / "y")
    assert (tmp_path / "x").read_text() == "text"


def test_a_configuration_that_strict_readers_refuse_is_never_written(tmp_path):
    with pytest.raises(ValueError, match="not JSON compliant"):
        RunFolder.create(tmp_path / "x", {"settings": {"r_min": -math.inf}}, [DOMAIN])
    assert os.listdir(tmp_path) == []


_KILL_AT_EACH_FILE = """
import os, sys
from serp._util import files
from serp.runs import folder, tables

for count in range(8):
    if os.fork():
        os.wait()
        continue
    left = iter(range(count))

    def killed(path, flags, opens=tables.open_regular):
        opened = opens(path, flags)
        if next(left, None) is None:
            os._exit(9)
        return opened

    for module in (files, tables):
        module.open_regular = killed
    folder.RunFolder.create(f"{sys.argv[1]}/{count}", {}, [("d.pddl", "(define)")])
    os._exit(0)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no fork")
def test_a_run_killed_before_it_began_is_begun_anew(tmp_path):
    """Wherever the process ended: a file has been opened, and none of the later ones is there."""
    subprocess.run([sys.executable, "-c", _KILL_AT_EACH_FILE, str(tmp_path)], check=True)
    states = [sorted(os.listdir(tmp_path / str(count))) for count in range(8)]
    assert states[0] == [".lock", "domain.pddl.aside"]
    assert "config.json" not in states[5]
    assert "config.json" in states[6]  # the tables are opened again, to be written
    (tmp_path / "locked").mkdir()
    (tmp_path / "locked" / ".lock").touch()
    for path in (tmp_path / "locked", *map(tmp_path.joinpath, map(str, range(6)))):
        with pytest.raises(RunError, match=rf"before it began.*--out {path}"):
            RunFolder.open(path)
        create(path).close()
        assert sorted(os.listdir(path)) == states[-1]
        assert RunFolder.open(path).domain_file.read_text() == DOMAIN[1]


@pytest.mark.parametrize("name", ["domain.pddl", "metrics.csv", "thesis.tex"])
def test_a_file_of_the_users_own_is_never_taken_for_what_a_run_left(tmp_path, name):
    (tmp_path / name).write_text("years of work")
    for lock in (False, True):
        if lock and name == "thesis.tex":
            (tmp_path / ".lock").touch()
        with pytest.raises(RunError, match="is not empty"):
            create(tmp_path)
        assert (tmp_path / name).read_text() == "years of work"


_FILL_THE_DISK = """
import resource, sys
from serp.errors import RunError
from serp.runs.folder import RunFolder
resource.setrlimit(resource.RLIMIT_FSIZE, (150, 150))  # config.json, the last file, is larger
try:
    RunFolder.create(sys.argv[1], {}, [("d.pddl", "(define)")])
except RunError as error:
    print(error)
"""


@pytest.mark.parametrize("there", [False, True])
def test_a_run_that_cannot_be_written_leaves_nothing_behind(tmp_path, there):
    path = tmp_path / "x"
    if there:
        path.mkdir()
    done = subprocess.run(
        [sys.executable, "-c", _FILL_THE_DISK, str(path)], capture_output=True, text=True
    )
    assert "File too large" in done.stdout, done.stderr
    assert path.exists() == there
    assert not there or os.listdir(path) == []


def test_one_writer_at_a_time_and_any_number_of_readers(tmp_path):
    with create(tmp_path / "x") as run:
        with pytest.raises(RunError, match="is being written by"):
            RunFolder.open(tmp_path / "x", writing=True)
        reader = RunFolder.open(tmp_path / "x")
        run.metrics.append(metrics_row(1))
        run.flush()
        assert len(read_metrics(reader.path / METRICS)["episode"]) == 1
    RunFolder.open(tmp_path / "x", writing=True).close()


def test_a_reader_cannot_write(tmp_path):
    create(tmp_path / "x").close()
    reader = RunFolder.open(tmp_path / "x")
    for write in (
        lambda: reader.metrics,
        lambda: reader.decisions,
        reader.flush,
        lambda: reader.write("report.md", ""),
        lambda: reader.save_checkpoint({}, {}),
    ):
        with pytest.raises(RunError, match="not open for writing"):
            write()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "is not a run: it has no config.json"),
        ("{", "is damaged"),
        ("[]", "not a JSON object"),
        ("{}", "was not written by serp"),
        (
            '{"format": 1, "config": {}}',
            r"an earlier version of serp \(unknown\), with other names",
        ),
        (about(format=1, versions={"serp": "0.1.0"}), r"an earlier version of serp \(0\.1\.0\)"),
        ('{"format": 2, "config": {}}', "was not written by serp"),
        ('{"format": 99, "config": {}, "domain_files": {}}', "has format 99; .* newer serp"),
        (about(created=None), "created is missing or not a str"),
        (about(machine=[]), "machine is missing or not a dict"),
        (about(command=["serp", 3]), "command and domain_files must hold strings"),
    ],
)
def test_what_is_no_run_is_refused(tmp_path, content, message):
    if content is not None:
        (tmp_path / "config.json").write_text(content)
    for writing in (False, True):
        with pytest.raises(RunError, match=message):
            RunFolder.open(tmp_path, writing=writing)
    assert set(os.listdir(tmp_path)) <= {"config.json"}


def test_resumed_tables_equal_uninterrupted_ones(tmp_path):
    def episodes(run, numbers):
        for episode in numbers:
            for step in range(10):
                run.decisions.append(decision_row(10 * episode + step))
            run.metrics.append(metrics_row(episode))

    with create(tmp_path / "once") as run:
        episodes(run, range(9))
    with create(tmp_path / "twice") as run:
        episodes(run, range(4))
        run.save_checkpoint({"x": np.arange(3)}, {"episode": 4})
        episodes(run, range(4, 7))  # done again after the resume
        run.decisions.append(decision_row(70))
    with RunFolder.open(tmp_path / "twice", writing=True) as run:
        found = run.resume()
        assert found.meta == {"episode": 4}
        assert found.arrays["x"].tolist() == [0, 1, 2]
        episodes(run, range(found.meta["episode"], 9))
    for table in (METRICS, DECISIONS):
        assert (tmp_path / "once" / table).read_bytes() == (tmp_path / "twice" / table).read_bytes()


def test_resume_from_the_previous_checkpoint_keeps_it_at_the_next_save(tmp_path):
    path = tmp_path / "x"
    with create(path) as run:
        for episode in range(3):
            run.metrics.append(metrics_row(episode))
            run.save_checkpoint({}, {"episode": episode})
    (path / NEWEST).write_bytes((path / NEWEST).read_bytes()[:50])
    assert RunFolder.open(path).load_checkpoint().meta["episode"] == 1
    assert (path / NEWEST).exists()  # a reader renames nothing
    with RunFolder.open(path, writing=True) as run:
        found = run.resume()
        assert found.meta == {"episode": 1}
        assert "is damaged" in found.fallback
        assert len(read_metrics(path / METRICS)["episode"]) == 2
        run.save_checkpoint({}, {"episode": 2})
        assert run.load_checkpoint().fallback is None
    assert (path / DAMAGED).stat().st_size == 50
    (path / NEWEST).unlink()
    kept = RunFolder.open(path).load_checkpoint()
    assert (kept.path.name, kept.meta["episode"]) == (PREVIOUS, 1)


def test_what_is_not_there_cannot_be_opened_or_resumed(tmp_path):
    with pytest.raises(RunError, match="no such folder"):
        RunFolder.open(tmp_path / "gone")
    create(tmp_path / "x").close()
    with (
        RunFolder.open(tmp_path / "x", writing=True) as run,
        pytest.raises(RunError, match="there is no checkpoint"),
    ):
        run.resume()


def test_a_table_that_was_changed_since_the_checkpoint_is_refused(tmp_path):
    with create(tmp_path / "x") as run:
        for step in range(100):
            run.decisions.append(decision_row(step))
        run.save_checkpoint({}, {})
    for name in (DECISIONS, METRICS):
        file = tmp_path / "x" / name
        content = file.read_bytes()
        file.write_bytes(content[:-2] + (b"7" if content[-2:-1] != b"7" else b"8") + content[-1:])
        with (
            pytest.raises(
                RunError, match=rf"{name} .*changed (since|after)|{name}:1: has other columns"
            ),
            RunFolder.open(tmp_path / "x", writing=True) as run,
        ):
            run.resume()
        file.write_bytes(content)


def test_without_a_whole_checkpoint_it_is_said_what_to_do(tmp_path):
    with create(tmp_path / "x") as run:
        run.save_checkpoint({}, {})
        run.save_checkpoint({}, {})
    for name in (NEWEST, PREVIOUS):
        (tmp_path / "x" / name).write_bytes(b"")
    with pytest.raises(
        RunError, match=r"damaged.*The one before it.*damaged.*restore a checkpoint from a copy"
    ):
        RunFolder.open(tmp_path / "x").load_checkpoint()


def test_summary_is_json_for_strict_readers(tmp_path):
    summary = {"a": math.nan, "b": [math.inf, np.float64(0.5)], "c": {"d": np.int64(3)}}
    with create(tmp_path / "x") as run:
        with pytest.raises(RunError, match=r"cannot read .*summary\.json"):
            run.read_summary()
        run.write_summary(summary)
        assert run.read_summary() == {"a": None, "b": [None, 0.5], "c": {"d": 3}}

    def refuse(word):
        raise AssertionError(word)

    json.loads((tmp_path / "x" / "summary.json").read_text(), parse_constant=refuse)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")
def test_an_error_in_the_run_is_not_hidden_by_a_full_disk_at_its_end(tmp_path):
    with create(tmp_path / "x") as run:
        run.metrics.append(metrics_row(1))
        full = os.open("/dev/full", os.O_WRONLY)
        os.dup2(full, run.metrics._file)
        os.close(full)
        with pytest.raises(RunError, match="No space left on device"):
            run.flush()
        with pytest.raises(ZeroDivisionError), run:
            raise ZeroDivisionError
    RunFolder.open(tmp_path / "x", writing=True).close()  # the lock was given back all the same
