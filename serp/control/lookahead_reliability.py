"""The reliability of the lookahead, measured by its failures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from serp._util.saved_state import Saved

_TOLERATED: Final = 3
"""Tolerated failures at first."""
_PER_STEP: Final = 0.001
"""Tolerated failures per env step in the long run."""


class LookaheadReliability:
    """Counts the failures of the lookahead.

    The lookahead predicts an executed action to be safe if a plan exists that avoids everything
    unsafe within the horizon, in control periods. It has failed if something unsafe is observed
    within the horizon nevertheless. A lookahead that fails more often than tolerated (plus once per
    1,000 env steps) does not model what endangers the robot, so its vetoes beyond the next step are
    not justified.
    """

    def __init__(self, horizon: int) -> None:
        self._horizon = horizon
        self.failures = 0
        self.steps = 0
        self._since: dict[int, int] = {}
        """Environment → env steps since the newest prediction of safety in its episode."""

    @property
    def reliable(self) -> bool:
        """Whether vetoes use the lookahead beyond the next step."""
        return self.failures <= _TOLERATED + _PER_STEP * self.steps

    def observe(self, predicted_safe: bool | None, unsafe: bool, last: bool, lane: int = 0) -> bool:
        """Process an env step; return whether the lookahead failed.

        `predicted_safe` is None for an action that the model does not know, which invalidates
        earlier predictions; `unsafe` is what was observed; `last` the end of the episode; `lane`
        the environment.
        """
        self.steps += 1
        since = self._since.pop(lane, None)
        if predicted_safe is None:
            since = None
        elif predicted_safe:
            since = 0
        elif since is not None:
            since += 1
        failed = unsafe and since is not None and since < self._horizon
        self.failures += failed
        if since is not None and not (failed or last):
            self._since[lane] = since
        return failed

    def cut_off(self, lane: int = 0) -> None:
        """Note that the episode of an environment goes on no further."""
        self._since.pop(lane, None)

    def state_dict(self) -> dict[str, Any]:
        """Return JSON values that `load_state_dict` restores exactly, between episodes."""
        return {"failures": self.failures, "steps": self.steps}

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned."""
        saved = Saved("lookahead reliability", {}, meta)
        self.failures, self.steps = saved.whole("failures"), saved.whole("steps")
        self._since.clear()
