"""The progress of a training: its numbers, its speed, and the remaining time."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Self

from serp.training.budget import Budget

_MEMORY: Final = 30.0  # seconds over which the speed is measured
_TOO_SHORT: Final = 0.5  # seconds over which a measured speed would be noise


@dataclass(frozen=True, slots=True)
class ProgressStats:
    """The numbers of a training in progress.

    Attributes:
        episode: Number of complete episodes.
        env_steps: Number of env steps.
        units: Number of complete units of `arbiter.rho_unit`.
        last_return: Return of the last episode; None before the first has ended.
        mean_return: Mean return of the last 20 episodes; None before the first has ended.
        rho: Learner probability; None without a learner.
        vetoes: Number of proposals refused.
        unsafe_executed: Number of executed actions that were flagged unsafe.
        wall_time: Seconds of training, as in the run's metrics.
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
        """Env steps per second since the run began, as in its summary; None at its beginning."""
        return self.env_steps / self.wall_time if self.wall_time > 0 else None


class Progress:
    """A display; this base class shows nothing.

    Used as a context manager around the training. In the loop::

        if progress.due():
            progress.update(ProgressStats(...))

    and `update` once more after every episode. `due` only reads the clock, so that it can be called
    in every step.

    Args:
        budget: The budget of the training.
        unit: Name of its unit.
        start: The numbers when this process begins; those of a resumed run are not 0.
        clock: Monotonic clock, seconds.
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
        self._next = float("inf")  # time of the next refresh
        self._latest = start or ProgressStats(0, 0)
        self._samples: deque[ProgressStats] = deque()
        self._moving = False

    def due(self) -> bool:
        """Return whether it is time for the next refresh."""
        return self._clock() >= self._next

    def update(self, stats: ProgressStats) -> None:
        """Set the newest numbers, and show them if a refresh is due."""
        if not self._moving and stats.env_steps > self._latest.env_steps:
            # The time before the first step, mostly compilation, does not count for the speed.
            self._moving = True
            self._samples.clear()
            self._samples.append(stats)
        self._latest = stats
        if self.due():
            self._show()

    def note(self, text: str) -> None:
        """Show a permanent line, such as a warning; a quiet display shows nothing."""

    def answer(self, text: str) -> None:
        """Show a line in response to a key; even a quiet display shows it on a terminal."""
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
        """Return counts per second of training over the last half minute; 0 if unknown."""
        first = self._samples[0]
        seconds = self._samples[-1].wall_time - first.wall_time
        counts = zip(_counts(first), _counts(self._latest), strict=True)
        known = seconds >= _TOO_SHORT
        return {
            name: (now - before) / seconds if known else 0.0 for (name, before), (_, now) in counts
        }

    def _ends(self) -> dict[str, int]:
        """Return the limits of the budget by name."""
        return {name: end for name, end in self._budget.as_dict().items() if end is not None}

    def _done(self) -> float | None:
        """Return the share of the budget that is spent, in [0, 1]; None without a budget."""
        now = dict(_counts(self._latest))
        return max((min(1.0, now[name] / end) for name, end in self._ends().items()), default=None)

    def _seconds_left(self) -> float | None:
        """Return the estimated seconds until the first limit is reached; None if unknown."""
        now, speeds = dict(_counts(self._latest)), self._speeds()
        left = [
            max(0, end - now[name]) / speeds[name]
            for name, end in self._ends().items()
            if speeds[name] > 0
        ]
        return min(left, default=None)


def _counts(stats: ProgressStats) -> tuple[tuple[str, int], ...]:
    return ("episodes", stats.episode), ("env_steps", stats.env_steps), ("units", stats.units)
