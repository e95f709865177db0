"""Ctrl-C during a training: the first ends it with the episode, the second at once."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

ANSWER = (
    "Ctrl-C: finishing the episode, so that nothing is lost. Press it again to stop at once; the "
    "run then continues from its last checkpoint."
)


class Stopping:
    """Whether the user asked to stop.

    Attributes:
        requested: Ctrl-C was pressed.
    """

    def __init__(self) -> None:
        self.requested = False
        self._answered = False

    def answer_due(self) -> bool:
        """Whether the user is to be told that the request was heard; true once."""
        due = self.requested and not self._answered
        self._answered = self._answered or due
        return due


@contextlib.contextmanager
def stop_between_episodes() -> Iterator[Stopping]:
    """Turn the first Ctrl-C into a request; a second one raises KeyboardInterrupt as ever.

    The handler itself shows nothing, for it may have interrupted the display in the middle of a
    line: whoever trains asks `answer_due` after every step. Outside the main thread, and where
    Ctrl-C is ignored (a job in the background) or handled by a program around Python, all is left
    as it is.
    """
    stopping = Stopping()
    if threading.current_thread() is not threading.main_thread():
        yield stopping
        return
    before = signal.getsignal(signal.SIGINT)
    if before in (None, signal.SIG_IGN):
        yield stopping
        return

    def request(number: int, frame: FrameType | None) -> None:
        stopping.requested = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    signal.signal(signal.SIGINT, request)
    try:
        yield stopping
    finally:
        signal.signal(signal.SIGINT, before)
