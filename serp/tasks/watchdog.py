"""Reports an environment that does not return from a call."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Self

from serp._util.closing import Closing
from serp.tasks.bound_task import BoundTask


class Watchdog(Closing):
    """Watches an environment from its own thread, and reports once that a call takes long.

    It is a context manager around the calls of the environment. It cannot watch an environment that
    never releases Python's global interpreter lock.

    Args:
        task: The task with the environment.
        seconds: A call that takes longer is reported; infinity: none is.
        step: Returns the number of the current env step.
        say: Called with the message, in the watching thread.
    """

    def __init__(
        self,
        task: BoundTask,
        seconds: float,
        step: Callable[[], int],
        say: Callable[[str], None],
    ) -> None:
        self._task = task
        self._seconds = seconds
        self._step = step
        self._say = say
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="serp watchdog", daemon=True)

    def __enter__(self) -> Self:
        if math.isfinite(self._seconds):
            self._thread.start()
        return self

    def close(self) -> None:
        """Stop watching."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()

    def _watch(self) -> None:
        while not self._over.wait(min(1.0, self._seconds / 4)):
            call = self._task.call
            if call is not None and time.monotonic() - call.since >= self._seconds:
                self._say(
                    f"The environment has not returned for {self._seconds:g} s: {call.what}, env "
                    f"step {self._step():,}. This is reported once; two Ctrl-C stop at once."
                )
                return
