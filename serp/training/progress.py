"""Where a training stands: its numbers, its speed, and the time that is left."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Self

from serp.training.budget import Budget

_MEMORY: Final = 30.0  # seconds over which speed is measured
_TOO_SHORT: Final = 0.5  # seconds, within which speed is noise


@dataclass(frozen=True, slots=True)
class ProgressStats:
    """Where a training stands.

    Attributes:
        episode: Episodes ended so far.
        env_steps: Steps in the environment so far.
        units: Units of the learner probability that have ended so far.
        last_return: Return of the last episode; None before the first has ended.
        mean_return: Mean return of the last 20 episodes; None before the first has ended.
        rho: Learner probability; None where there is no learner.
        vetoes: Proposals refused so far.
        unsafe_executed: Executed actions that were unsafe, so far.
        wall_time: Seconds of training so far, as in the run's metrics.
    """

    episode: int
    env_steps: int
    last_return: float | None = None
    mean_return: float | None = None
    rho: float | None = None
    vetoes: int = 0
    unsafe_executed: int = 0
    units: int = 0
    wall_time: float = 0.0

    @property
    def steps_per_second(self) -> float | None:
        """Env steps a second since the run began, as in its summary; None before any time."""
        return self.env_steps / self.wall_time if self.wall_time > 0 else None


class Progress:
    """A display; this base class shows nothing.

    Used as a context manager around the training. In the loop::

        if progress.due():
            progress.update(ProgressStats(...))

    and `update` once more after every episode. `due` costs a look at the clock, so that it can
    stand in every step.

    Args:
        budget: When the training ends.
        unit: What a unit of it is.
        start: Where the run stands as this process begins (a resumed run has steps already).
        clock: Seconds, monotonic.
    """

    def __init__(
        self,
        budget: Budget | None = None,
        unit: str = "unit",
        start: ProgressStats | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._budget = budget or Budget()
        self._unit = unit
        self._clock = clock
        self._next = float("inf")  # when the next picture is due
        self._latest = start or ProgressStats(0, 0)
        self._samples: deque[ProgressStats] = deque()
        self._moving = False

    def due(self) -> bool:
        """Return whether it is time for the next picture."""
        return self._clock() >= self._next

    def update(self, stats: ProgressStats) -> None:
        """Take the newest numbers, and shows them if it is time to."""
        if not self._moving and stats.env_steps > self._latest.env_steps:
            # What came before the first step, compilation above all, says nothing of the speed.
            self._moving = True
            self._samples.clear()
            self._samples.append(stats)
        self._latest = stats
        if self.due():
            self._show()

    def note(self, text: str) -> None:
        """Show one line that stays, such as a warning; nothing where the display is quiet."""

    def answer(self, text: str) -> None:
        """Show one line in answer to a key, where somebody sits: even if the display is quiet."""
        self.note(text)

    def __enter__(self) -> Self:
        self._sample()
        return self

    def __exit__(self, *exception: object) -> None:
        pass

    def _show(self) -> None:
        pass

    def _sample(self) -> None:
        now = self._latest.wall_time
        self._samples.append(self._latest)
        while len(self._samples) > 2 and self._samples[1].wall_time <= now - _MEMORY:
            self._samples.popleft()

    def _speeds(self) -> dict[str, float]:
        """Return what is done in a second, over the last half minute, by name; 0 where unknown.

        Seconds of training: what is compiled or loaded on the way says nothing of the speed.
        """
        first = self._samples[0]
        seconds = self._samples[-1].wall_time - first.wall_time
        counts = zip(_counts(first), _counts(self._latest), strict=True)
        known = seconds >= _TOO_SHORT
        return {
            name: (now - before) / seconds if known else 0.0 for (name, before), (_, now) in counts
        }

    def _ends(self) -> dict[str, int]:
        """Return the ends of the budget that there are, by name."""
        return {name: end for name, end in self._budget.as_dict().items() if end is not None}

    def _done(self) -> float | None:
        """Return the share of the budget that is spent, in [0, 1]; None without a budget."""
        now = dict(_counts(self._latest))
        return max((min(1.0, now[name] / end) for name, end in self._ends().items()), default=None)

    def _seconds_left(self) -> float | None:
        """Until the first budget is spent; None where that cannot be said."""
        now, speeds = dict(_counts(self._latest)), self._speeds()
        left = [
            max(0, end - now[name]) / speeds[name]
            for name, end in self._ends().items()
            if speeds[name] > 0
        ]
        return min(left, default=None)


def _counts(stats: ProgressStats) -> tuple[tuple[str, int], ...]:
    return ("episodes", stats.episode), ("env_steps", stats.env_steps), ("units", stats.units)
