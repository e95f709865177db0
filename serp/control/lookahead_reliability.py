"""How far the lookahead can be relied on: how often it failed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from serp._util.saved_state import Saved

_PER_STEP: Final = 0.001
"""Failures an env step that are tolerated in the long run."""


class LookaheadReliability:
    """Counts the failures of the lookahead.

    Where the executed action leads, within the lookahead, to no state in which every action is
    flagged or too risky, the lookahead has predicted that everything unsafe can be avoided for as
    long. It has failed where something unsafe is observed within that time all the same. A
    lookahead that fails again and again does not know what endangers the robot; what it refuses
    beyond the next step is refused without reason.

    Args:
        horizon: Control periods that the lookahead sees.
        tolerated: Failures that are tolerated at once; one more is every 1,000 env steps. None
            tolerates all.

    Attributes:
        failures: How often it failed.
        steps: Env steps that were observed.
    """

    def __init__(self, horizon: int, tolerated: int | None) -> None:
        self._horizon = horizon
        self._tolerated = tolerated
        self.failures = 0
        self.steps = 0
        self._since: int | None = None
        """Env steps since this episode's newest prediction of safety."""

    @property
    def reliable(self) -> bool:
        """Whether the lookahead is relied on beyond the next step."""
        return self._tolerated is None or self.failures <= self._tolerated + _PER_STEP * self.steps

    def observe(self, predicted_safe: bool | None, unsafe: bool, last: bool) -> bool:
        """Take an env step into account.

        Args:
            predicted_safe: Whether the lookahead predicted the executed action to be safe; None
                for an action that the model does not know, after which no prediction counts.
            unsafe: Whether something unsafe was observed.
            last: Whether the episode ended with it.

        Returns:
            Whether the lookahead failed.
        """
        self.steps += 1
        if predicted_safe is None:
            self._since = None
        elif predicted_safe:
            self._since = 0
        elif self._since is not None:
            self._since += 1
        failed = unsafe and self._since is not None and self._since < self._horizon
        self.failures += failed
        if failed or last:
            self._since = None
        return failed

    def state_dict(self) -> dict[str, Any]:
        """Return JSON values that `load_state_dict` restores exactly, between episodes."""
        return {"failures": self.failures, "steps": self.steps}

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It is damaged.
        """
        saved = Saved("lookahead reliability", {}, meta)
        self.failures, self.steps = saved.whole("failures"), saved.whole("steps")
        self._since = None
