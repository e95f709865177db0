"""Real time: a simulated second takes a second."""

from __future__ import annotations

import time


class Pacer:
    """Waits until simulated time is due, measured from the last restart."""

    __slots__ = ("_due",)

    def __init__(self) -> None:
        self._due = time.monotonic()

    def restart(self) -> None:
        """Start simulated time now."""
        self._due = time.monotonic()

    def wait(self, seconds: float) -> None:
        """Wait until that much simulated time after the last call is due.

        A delay is not caught up with: a late call is due at once.
        """
        self._due += seconds
        left = self._due - time.monotonic()
        if left > 0.0:
            time.sleep(left)
        else:
            self._due -= left
