"""How long numba has compiled in this process: time that is not part of training.

What is compiled is kept on disk, so a loop costs this once after an installation or an edit. Times
that are reported (seconds of training, steps a second) leave it out wherever it comes up.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

from numba.core import event


class _CompileTimer(event.Listener):
    """Adds up the time of compilation; what is compiled for another function counts once."""

    def __init__(self) -> None:
        self.loops = 0
        self.on_loop: Callable[[], None] | None = None
        self._lock = threading.Lock()
        self._depth = 0
        self._begin = 0.0
        self._total = 0.0
        self._name: Any = None

    @property
    def seconds(self) -> float:
        with self._lock:
            running = time.monotonic() - self._begin if self._depth else 0.0
            return self._total + running

    def on_start(self, event: Any) -> None:
        name = _name_of(event.data)
        with self._lock:
            self._depth += 1
            if self._depth > 1:
                return
            self._begin = time.monotonic()
            fresh = name != self._name
            self._name = name
            self.loops += fresh
        if fresh and self.on_loop is not None:
            self.on_loop()

    def on_end(self, event: Any) -> None:
        with self._lock:
            self._depth -= 1
            if not self._depth:
                self._total += time.monotonic() - self._begin


def _name_of(data: Any) -> Any:
    """Return what tells functions apart that are being compiled."""
    dispatcher = data.get("dispatcher")
    if dispatcher is not None:
        return dispatcher.py_func.__module__, dispatcher.py_func.__qualname__
    return data["module"], data["qualname"]


_TIMER: Final = _CompileTimer()
# Callbacks, whose compilation is not an event of its own, have passes too. Neither event comes up
# where machine code is read from disk.
for _kind in ("numba:compile", "numba:run_pass"):
    event.register(_kind, _TIMER)  # type: ignore[no-untyped-call]


def compile_seconds() -> float:
    """Return the seconds that this process has spent on compiling."""
    return _TIMER.seconds


def compiled_functions() -> int:
    """Return how many functions this process has compiled."""
    return _TIMER.loops


def working_time() -> float:
    """Return a monotonic clock, in seconds, that stands still while something is compiled."""
    return time.monotonic() - _TIMER.seconds


@contextmanager
def notifying_of_compilation(tell: Callable[[], None]) -> Iterator[None]:
    """Call a function whenever the compilation of another loop begins."""
    before, _TIMER.on_loop = _TIMER.on_loop, tell
    try:
        yield
    finally:
        _TIMER.on_loop = before
