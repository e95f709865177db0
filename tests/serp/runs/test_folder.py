"""The run folder: begun once, written by one process, continued where its checkpoint was made."""

import json
import os
import signal
import subprocess
import sys

import pytest

from serp.errors import RunError
from serp.runs.folder import default_path
from serp.runs.run import Run
from serp.runs.run_config import Budget, RunConfig
from serp.settings import Settings
from serp.tasks.registry import load_task

CONFIG = RunConfig(
    task="cartpole", domain="cartpole", max_ground_schemas=9, preset="default", seed=3,
    reward="domain", learned_from="domain", file_rewards=True, control_period=0.02,
    budget=Budget(), settings=Settings(),
)  # fmt: skip


def create(path):
    task = load_task("cartpole").bind()
    return Run.begin(path, task, Settings(), preset="paper", seed=3, budget=Budget())


def about(**other):
    """A ``config.json`` in which one thing is another."""
    whole = {
        "format": 6, "created": "2026-11-21T04:05:06+00:00", "command": ["serp"], "seed": 1,
        "domain_files": {"domain.pddl": "d.pddl"}, "versions": {}, "machine": {},
        "config": CONFIG.model_dump(mode="json"),
    }  # fmt: skip
    return json.dumps(whole | other)


# The beginning -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["../../etc/x", "a/b", "..", "", "größe ρ", "-rf", "C:\\x"])
def test_no_name_leads_out_of_the_root(name):
    path = default_path(name)
    assert path.parent.parts == ("runs",)
    assert not path.name.startswith(("-", "."))


def test_a_run_is_begun_in_an_empty_folder_and_once_only(tmp_path):
    path = tmp_path / "x"
    create(path).close()
    before = {file.name: file.read_bytes() for file in path.iterdir()}
    with pytest.raises(RunError, match=r"already holds a run.*--resume.*--out"):
        create(path)
    assert {file.name: file.read_bytes() for file in path.iterdir()} == before
    (tmp_path / "file").write_text("text")
    with pytest.raises(RunError, match="is a file"):
        create(tmp_path / "file")
    with pytest.raises(RunError, match=r"cannot write .*Not a directory"):
        create(tmp_path / "file" / "y")
    assert (tmp_path / "file").read_text() == "text"


@pytest.mark.parametrize("name", ["domain.pddl", "metrics.csv", "thesis.tex"])
def test_a_file_of_the_users_own_is_never_taken_for_what_a_run_left(tmp_path, name):
    (tmp_path / name).write_text("years of work")
    for lock in (False, True):
        if lock and name != "domain.pddl":  # a comparison, or a run that has lost its config.json
            (tmp_path / ".lock").touch()
        with pytest.raises(RunError, match="is not empty"):
            create(tmp_path)
        assert (tmp_path / name).read_text() == "years of work"


# Reading and writing -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "is not a run: it has no config.json"),
        ("{", "is damaged"),
        ("[]", "not a JSON object"),
        ('{"config": {}}', r"another version of serp \(unknown\): it has format None"),
        (about(format=99, versions={"serp": "9.1.0"}), r"another version of serp \(9\.1\.0\)"),
        ('{"format": 6, "config": {}}', "was not written by serp"),
        (about(command=["serp", 3]), r"damaged: command\.1: Input should be a valid string"),
        (about(config=about()), r"damaged: config: Input should be"),
    ],
)
def test_what_is_no_run_is_refused(tmp_path, content, message):
    if content is not None:
        (tmp_path / "config.json").write_text(content)
    with pytest.raises(RunError, match=message):
        Run(tmp_path)
    assert set(os.listdir(tmp_path)) <= {"config.json"}
    with pytest.raises(RunError, match="there is no run"):
        Run(tmp_path / "gone")


_HOLD = """
import sys, time
from pathlib import Path
from serp.runs.run import Run
with Run(Path(sys.argv[1])).lock():
    print(flush=True)
    time.sleep(60)
"""


def test_one_writer_at_a_time_until_it_dies_and_any_number_of_readers(tmp_path):
    with create(tmp_path) as run:
        with pytest.raises(RunError, match="is being written by"):
            Run(tmp_path).lock()
        assert Run(tmp_path).metadata == run.metadata
    command = [sys.executable, "-c", _HOLD, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as child:
        child.stdout.readline()
        with pytest.raises(RunError, match=rf"is being written by process {child.pid} on "):
            Run(tmp_path).lock()
        child.send_signal(signal.SIGKILL)
        child.wait()
        Run(tmp_path).lock().close()
