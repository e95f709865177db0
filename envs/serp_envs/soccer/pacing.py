"""Real time: a simulated second takes a second."""

from __future__ import annotations

import time


class Pacer:
    """Waits until simulated time is due, measured from the last restart."""

    __slots__ = ("_due",)

    def __init__(self) -> None:
        """A pacer that starts now."""
        self._due = time.monotonic()

    def restart(self) -> None:
        """Simulated time starts now."""
        self._due = time.monotonic()

    def wait(self, seconds: float) -> None:
        """Wait until that much simulated time after the last call is due.

        What was slow before is not caught up with: late means due now.
        """
        self._due += seconds
        left = self._due - time.monotonic()
        if left > 0.0:
            time.sleep(left)
        else:
            self._due -= left
