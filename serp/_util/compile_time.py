"""The time that numba has spent compiling in this process.

Compiled code is cached on disk, so a loop is compiled once after an installation or an edit.
Reported times (seconds of training, steps per second) exclude compilation.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

from numba.core import event


class _CompileTimer(event.Listener):
    """Adds up the time of compilation; nested compilations count once."""

    def __init__(self) -> None:
        self.loops = 0
        self.on_loop: Callable[[], None] | None = None
        self._lock = threading.Lock()
        self._depth = 0
        self._begin = 0.0
        self._total = 0.0
        self._name = ""

    @property
    def seconds(self) -> float:
        with self._lock:
            running = time.monotonic() - self._begin if self._depth else 0.0
            return self._total + running

    def on_start(self, event: Any) -> None:
        with self._lock:
            self._depth += 1
            if self._depth > 1:
                return
            self._begin = time.monotonic()
            before, self._name = self._name, _name_of(event.data)
            fresh = before != self._name
            self.loops += fresh
        if fresh and self.on_loop is not None:
            self.on_loop()

    def on_end(self, event: Any) -> None:
        with self._lock:
            self._depth -= 1
            if not self._depth:
                self._total += time.monotonic() - self._begin


def _name_of(data: Any) -> str:
    """Return what identifies the function that is being compiled."""
    if "dispatcher" in data:
        return f"{data['dispatcher'].py_func.__module__}.{data['dispatcher'].py_func.__qualname__}"
    return f"{data['module']}.{data['qualname']}"


_TIMER: Final = _CompileTimer()
# The compilation of a callback raises no `numba:compile` event, but its passes do raise theirs.
# Neither event is raised when machine code is read from disk.
for _kind in ("numba:compile", "numba:run_pass"):
    event.register(_kind, _TIMER)  # type: ignore[no-untyped-call]


def compile_seconds() -> float:
    """Return the seconds that this process has spent compiling."""
    return _TIMER.seconds


def compiled_functions() -> int:
    """Return how many functions this process has compiled."""
    return _TIMER.loops


def working_time() -> float:
    """Return the time of a monotonic clock, in seconds, that stops during compilation."""
    return time.monotonic() - _TIMER.seconds


@contextmanager
def notifying_of_compilation(tell: Callable[[], None]) -> Iterator[None]:
    """Call a function whenever the compilation of a loop begins."""
    before, _TIMER.on_loop = _TIMER.on_loop, tell
    try:
        yield
    finally:
        _TIMER.on_loop = before
