"""Loops that are compiled once, and again when anything that they are made of is edited."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

FILES = {
    "layout": """
from typing import NamedTuple

PLACE = 1.0
SHAPE = (1, 2)

class Pair(NamedTuple):
    first: float
    second: float
""",
    "inner": """
import layout
from serp._util.compilation import cached_njit

@cached_njit()
def inner(x):
    return x + layout.PLACE
""",
    "outer": """
from inner import inner
from layout import SHAPE as _SHAPE
from layout import Pair
from numba import float64
from serp._util.compilation import cached_cfunc, cached_njit

@cached_njit()
def outer(x):
    return inner(x) + _SHAPE[1] + Pair(*(0.0, x)).first

@cached_cfunc(float64(float64))
def callback(x):
    return outer(x)

print(outer(10.0), callback.ctypes(10.0), sum(outer.stats.cache_hits.values()))
""",
}


def in_another_process(folder: Path) -> list[float]:
    """What the loops compute, and whether one was found in the cache."""
    ours = str(Path(__file__).parents[3])
    path = os.pathsep.join([ours, os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", "import outer"], env={**os.environ, "PYTHONPATH": path},
        cwd=folder, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return [float(word) for word in done.stdout.split()]


def test_a_loop_is_compiled_once_until_what_it_is_made_of_is_edited(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SERP_CACHE_DIR", str(tmp_path / "cache"))
    files = dict(FILES)

    def result() -> list[float]:
        """The same of modules that are imported anew, from another folder each time."""
        folder = Path(tempfile.mkdtemp(dir=tmp_path))
        for name, text in files.items():
            (folder / f"{name}.py").write_text(text, encoding="utf-8")
            monkeypatch.setitem(sys.modules, name, None)  # so that it is absent in the end
            del sys.modules[name]
        monkeypatch.syspath_prepend(folder)
        importlib.import_module("outer")
        return [float(word) for word in capsys.readouterr().out.split()]

    assert result() == [13.0, 13.0, 0]
    assert result() == [13.0, 13.0, 1]
    for name, old, new, expected in (
        ("layout", "(1, 2)", "(1, 4)", 15.0),  # a constant of another module
        ("layout", "PLACE = 1.0", "PLACE = 5.0", 19.0),  # one of a loop that is called
        ("inner", "x + ", "x * ", 54.0),  # a loop that is called
        ("layout", "first: float\n    second", "second: float\n    first", 64.0),  # a record
    ):
        files[name] = files[name].replace(old, new)
        assert result() == [expected, expected, 0], new
    assert in_another_process(Path(sys.path[0])) == [expected, expected, 1]
