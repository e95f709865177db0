"""Loops that are compiled once, and again when anything that they are made of is edited."""

from __future__ import annotations

import os
import subprocess
import sys
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


def result(folder: Path) -> list[float]:
    """What the loops compute in a process of their own, and whether one was found in the cache."""
    ours = str(Path(__file__).parents[3])
    path = os.pathsep.join([ours, os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "outer.py"], cwd=folder, capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONPATH": path, "SERP_CACHE_DIR": str(folder / "cache")},
    )  # fmt: skip
    return [float(word) for word in done.stdout.split()]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    return tmp_path


def test_a_loop_is_compiled_once_until_what_it_is_made_of_is_edited(folder: Path) -> None:
    assert result(folder) == [13.0, 13.0, 0]
    assert result(folder) == [13.0, 13.0, 1]
    for name, old, new, expected in (
        ("layout", "(1, 2)", "(1, 4)", 15.0),  # a constant of another module
        ("layout", "PLACE = 1.0", "PLACE = 5.0", 19.0),  # one of a loop that is called
        ("inner", "x + ", "x * ", 54.0),  # a loop that is called
        ("layout", "first: float\n    second", "second: float\n    first", 64.0),  # a record
    ):
        file = folder / f"{name}.py"
        file.write_text(file.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
        assert result(folder) == [expected, expected, 0], new
    assert result(folder) == [expected, expected, 1]


def test_what_a_loop_is_made_of_is_the_same_in_every_process() -> None:
    line = (
        "from serp._util import compilation as c\n"
        "print(c._stamp_of(c._names, {'fastmath': set('abcdef')}))"
    )
    stamps = {
        subprocess.run(
            [sys.executable, "-c", line], env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True, text=True, check=True,
        ).stdout
        for seed in ("1", "2")
    }  # fmt: skip
    assert len(stamps) == 1
