"""How far the lookahead can be believed: how often its word was broken."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from serp._util.saved_state import Saved

_PER_STEP: Final = 0.001
"""So many broken promises an env step are forgiven in the long run."""


class LookaheadReliability:
    """Counts what the lookahead promised and the world did not keep.

    Where the executed action leads, within the lookahead, to no place in which everything is
    flagged or too risky, the lookahead has promised that what is unsafe can be kept away for as
    long. The promise is broken where something unsafe is observed within that time all the same. A
    lookahead whose word is broken again and again knows nothing of what endangers the robot, and
    what it refuses beyond the next step is refused for no reason.

    Args:
        horizon: Control periods that the lookahead sees.
        forgiven: So many broken promises are forgiven at once, and one more every 1,000 env steps;
            None forgives all.
    """

    def __init__(self, horizon: int, forgiven: int | None) -> None:
        self._horizon = horizon
        self._forgiven = forgiven
        self.broken = 0
        self._steps = 0
        self._since: int | None = None
        """Env steps since the last promise of this episode."""

    @property
    def believed(self) -> bool:
        """Whether the lookahead is believed beyond the next step."""
        return self._forgiven is None or self.broken <= self._forgiven + _PER_STEP * self._steps

    def observe(self, promised: bool | None, unsafe: bool, last: bool) -> None:
        """Take an env step into account.

        Args:
            promised: Whether the executed action was promised to be safe; None for one that the
                model does not know, after which no promise holds any more.
            unsafe: Whether something unsafe was observed.
            last: Whether the episode ended with it.
        """
        self._steps += 1
        if promised is None:
            self._since = None
        elif promised:
            self._since = 0
        elif self._since is not None:
            self._since += 1
        if unsafe and self._since is not None and self._since < self._horizon:
            self.broken += 1
            self._since = None
        if last:
            self._since = None

    def state_dict(self) -> dict[str, Any]:
        """Return JSON values that `load_state_dict` restores exactly, between episodes."""
        return {"broken": self.broken, "steps": self._steps}

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It is damaged.
        """
        saved = Saved("promises of the lookahead", {}, meta)
        self.broken, self._steps = saved.whole("broken"), saved.whole("steps")
        self._since = None
