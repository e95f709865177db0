"""Signals during a training: the first ends it with the episode, the second at once.

Schedulers (Slurm, Kubernetes) send SIGTERM some time before they kill; a terminal that is closed
sends SIGHUP.
"""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Iterator
from types import FrameType
from typing import Final

SIGNALS: Final[tuple[signal.Signals, ...]] = (
    signal.SIGINT,
    signal.SIGTERM,
    *((signal.SIGHUP,) if hasattr(signal, "SIGHUP") else ()),  # Windows has none
)
_ECHO: Final = 1.0
"""Seconds in which SIGTERM or SIGHUP, sent once more, is the same request: `timeout`, shells and
schedulers send it to the process and to its group."""


class StoppedAtOnce(KeyboardInterrupt):
    """A second signal came.

    Attributes:
        signal: Its number.
    """

    def __init__(self, number: int) -> None:
        super().__init__()
        self.signal = number


class Stopping:
    """Whether the user asked to stop.

    Attributes:
        signal: The number of the signal that asked first; None: nobody has asked.
    """

    def __init__(self) -> None:
        self.signal: int | None = None
        self._since = 0.0
        self._answered = False

    @property
    def requested(self) -> bool:
        """Whether a signal came."""
        return self.signal is not None

    def answer(self, finishing: str, otherwise: str) -> str | None:
        """Return, once, what the user is to be told when the request was heard; else None.

        Args:
            finishing: What is finished first.
            otherwise: What a second signal leaves behind.
        """
        if self.signal is None or self._answered:
            return None
        self._answered = True
        pressed = self.signal == signal.SIGINT
        name = "Ctrl-C" if pressed else signal.Signals(self.signal).name
        again = "Press it again" if pressed else "Send another signal"
        return (
            f"{name}: finishing {finishing}, so that nothing is lost. {again} to stop at once; "
            f"{otherwise}."
        )

    def hear(self, number: int) -> None:
        """Take a signal.

        Raises:
            StoppedAtOnce: It is not the first.
        """
        now = time.monotonic()
        if self.signal is None:
            self.signal, self._since = number, now
        elif number == signal.SIGINT or number != self.signal or now - self._since > _ECHO:
            raise StoppedAtOnce(number)


@contextlib.contextmanager
def stop_between_episodes() -> Iterator[Stopping]:
    """Turn the first signal into a request; a second one raises `StoppedAtOnce`.

    The handler itself shows nothing, for it may have interrupted the display in the middle of a
    line: whoever trains asks for the `answer` after every step. Outside the main thread all is left
    as it is, and so is a signal that is ignored (Ctrl-C by a job in the background, SIGHUP under
    `nohup`) or handled by a program around this one; Ctrl-C alone is taken from a handler that is
    written in Python.
    """
    stopping = Stopping()
    if threading.current_thread() is not threading.main_thread():
        yield stopping
        return

    def hear(number: int, frame: FrameType | None) -> None:
        stopping.hear(number)

    before = {
        number: handler
        for number in SIGNALS
        if (handler := signal.getsignal(number)) not in (None, signal.SIG_IGN)
        and (number == signal.SIGINT or handler is signal.SIG_DFL)
    }
    try:
        for number in before:
            signal.signal(number, hear)
        yield stopping
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
