"""Compilation is told of, is left out of the time of training, and a rehearsal changes nothing."""

from __future__ import annotations

import io
import subprocess
import sys
import time

from numba import cfunc, njit, types

from serp._util.compilation import compile_seconds, working_time
from serp.runs.progress import show_compiling


def compile_something() -> float:
    """Compile a loop that calls another, and a callback; return the seconds that it took."""
    begin = time.monotonic()

    @njit
    def inner(x):  # type: ignore[no-untyped-def]
        return x + 1.0

    @njit
    def outer(x):  # type: ignore[no-untyped-def]
        return inner(x)

    outer(1.0)

    @cfunc(types.float64(types.float64))
    def callback(x):  # type: ignore[no-untyped-def]
        return x * 2.0

    return time.monotonic() - begin


def test_a_clock_of_work_stands_still_while_something_is_compiled() -> None:
    seconds, work = compile_seconds(), working_time()
    took = compile_something()
    counted = compile_seconds() - seconds
    assert 0.7 * took < counted <= took
    assert working_time() - work < 0.5 * took


def test_compilation_is_shown_where_there_is_any() -> None:
    quiet, idle, shown = io.StringIO(), io.StringIO(), io.StringIO()
    with show_compiling(stream=idle), show_compiling(stream=quiet, quiet=True):
        pass
    with show_compiling(stream=shown):
        compile_something()
    assert (quiet.getvalue(), idle.getvalue()) == ("", "")
    assert shown.getvalue().count("Compiling, once") == 1


TRAINING = """
import gc
from numba.core.registry import CPUDispatcher
from serp.tasks.registry import find_task
from serp.settings import resolve
from serp.runs.trainer import Trainer

def compiled():
    loops = [one for one in gc.get_objects() if isinstance(one, CPUDispatcher)]
    return {(one.py_func.__qualname__, *map(str, one.overloads)) for one in loops if one.overloads}

task = find_task("cliff")
trainer = Trainer(task.bind(), resolve("default", task.settings, {}), 5)
trainer.prepare()
before = compiled()
while trainer.env_steps < 600:
    trainer.run_episode()
print(sorted(compiled() - before))
"""


def test_nothing_is_left_to_compile_once_a_training_has_begun() -> None:
    # In a process of its own: in this one other tests have called the loops.
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", TRAINING], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"
