"""Signals during a training: the first ends it after the episode, the second at once.

Schedulers (Slurm, Kubernetes) send SIGTERM some time before SIGKILL; a closed terminal sends
SIGHUP.
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
"""Seconds in which a repeated SIGTERM or SIGHUP counts as the same request, because `timeout`,
shells and schedulers send it to the process and to its group."""


class StoppedAtOnce(KeyboardInterrupt):
    """A second signal was received; `signal` is its number."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.signal = number


class Stopping:
    """The state of a request to stop: `signal` is the number of the first signal, None for none."""

    def __init__(self) -> None:
        self.signal: int | None = None
        self._since = 0.0
        self._answered = False

    @property
    def requested(self) -> bool:
        """Whether a signal was received."""
        return self.signal is not None

    def answer(self, finishing: str, otherwise: str) -> str | None:
        """Return, once after a signal, what is finished first and what a second would do."""
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

    def hear(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal; raise `StoppedAtOnce` if it is not the first."""
        now = time.monotonic()
        if self.signal is None:
            self.signal, self._since = number, now
        elif number == signal.SIGINT or number != self.signal or now - self._since > _ECHO:
            raise StoppedAtOnce(number)


@contextlib.contextmanager
def stop_between_episodes() -> Iterator[Stopping]:
    """Turn the first signal into a request; a second one raises `StoppedAtOnce`.

    The handler itself shows nothing, because it may interrupt the display in the middle of a line;
    the training loop calls `answer` after every step. Outside the main thread no handler is set.
    Signals that are ignored (Ctrl-C in a background job, SIGHUP under `nohup`) or already handled
    are not changed either, except that a Python handler of Ctrl-C is replaced.
    """
    stopping = Stopping()
    if threading.current_thread() is not threading.main_thread():
        yield stopping
        return
    before = {
        number: handler
        for number in SIGNALS
        if (handler := signal.getsignal(number)) not in (None, signal.SIG_IGN)
        and (number == signal.SIGINT or handler is signal.SIG_DFL)
    }
    try:
        for number in before:
            signal.signal(number, stopping.hear)
        yield stopping
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
