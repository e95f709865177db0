"""What the tests of `serp` rely on."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.serp.sample_tasks import CORRIDOR, ROBOT


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A file with a task in the working directory."""
    monkeypatch.chdir(tmp_path)
    path, modules = list(sys.path), set(sys.modules)
    (tmp_path / "corridor.pddl").write_text(CORRIDOR)
    file = tmp_path / "my_robot.py"
    file.write_text(ROBOT)
    yield file
    sys.path[:] = path
    for name in set(sys.modules) - modules:
        if name.startswith("my_"):
            del sys.modules[name]
