"""The game clock: contests and the dead times between them fill games of ten minutes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

GAME: Final = 600.0
"""Length of a game, s (paper, section 4.2: "games lasting ten minutes")."""

_KEYS: Final = ("game", "seconds", "contest")


class GameClock:
    """Which game is on, how old it is, which of its contests comes next.

    Only contests that were played to their end count. The clock does not cut a contest short: the
    last one of a game ends after the 600th second, and the next one opens a new game.
    """

    __slots__ = ("contest", "game", "seconds")

    def __init__(self) -> None:
        self.game = 0
        """Number of the game, from 0."""
        self.seconds = 0.0
        """Age of the game when the last contest ended, dead time included, s."""
        self.contest = 0
        """Contests of this game that were played."""

    def start(self, game: int | None = None) -> None:
        """Start a contest, in a new game if this one is over, or with the kick-off of `game`."""
        if game is None and self.seconds >= GAME:
            game = self.game + 1
        if game is not None:
            self.game, self.seconds, self.contest = game, 0.0, 0

    def end(self, seconds: float) -> None:
        """End a contest that took so many seconds, approach and dead time included."""
        # Times are rounded to multiples of the tick, because sums of 0.1 are not exact.
        self.seconds = round(self.seconds + seconds, 6)
        self.contest += 1

    def state_dict(self) -> dict[str, Any]:
        """Return game, seconds and contest as JSON values."""
        return {key: getattr(self, key) for key in _KEYS}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Set the clock to what `state_dict` returned.

        Raises:
            ValueError: It is not a state of a clock.
        """
        counts = (state.get("game"), state.get("contest"))
        seconds = state.get("seconds")
        if set(state) != set(_KEYS) or not all(
            isinstance(count, int) and not isinstance(count, bool) and count >= 0
            for count in counts
        ):
            raise ValueError(f"a game clock needs the counts game and contest, not {dict(state)}")
        # The contest that ends a game begins within it and takes a minute or so.
        if (
            isinstance(seconds, bool)
            or not isinstance(seconds, int | float)
            or not 0.0 <= seconds < 2.0 * GAME
        ):
            raise ValueError(f"seconds of a game must be from 0 to {2.0 * GAME}, not {seconds!r}")
        self.game, self.contest = state["game"], state["contest"]
        self.seconds = float(seconds)
