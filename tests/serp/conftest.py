"""What the tests of `serp` rely on."""

import sys

import pytest

from serp._util.processes import one_thread
from tests.serp.sample_tasks import CORRIDOR, ROBOT


@pytest.fixture(scope="session", autouse=True)
def one_blas_thread():
    """As in a training: sums have the same bits whatever the number of cores."""
    with one_thread():
        yield


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working directory, empty."""
    monkeypatch.setenv("XDG_CONFIG_HOME", f"{tmp_path}-config")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def robot(folder):
    """A file with a task in the working directory."""
    path, modules = list(sys.path), set(sys.modules)
    (folder / "corridor.pddl").write_text(CORRIDOR)
    file = folder / "my_robot.py"
    file.write_text(ROBOT)
    yield file
    sys.path[:] = path
    for name in set(sys.modules) - modules:
        if name.startswith("my_"):
            del sys.modules[name]


@pytest.fixture(autouse=True)
def checkpoints_after_every_episode(monkeypatch):
    """A run that is stopped or killed in a test has what it needs to go on."""
    monkeypatch.setattr("serp.runs.train.CHECKPOINT_SECONDS", 0.0)
