"""The log of a training, for every kind of algorithm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import contextmanager
from typing import Any

from serp._util.compile_time import working_time
from serp._util.numbers import real
from serp.comparison.trial_records import EpisodeRow
from serp.control.step_record import StepRecord
from serp.errors import TaskError
from serp.tasks.env_checks import single
from serp.training.evaluation import outcome_of


class Log:
    """Collects the rows of the episodes of one training.

    Args:
        counters: Names of the counters that are logged as `info.<name>`.
        clock: Monotonic clock, seconds; by default without compilation.

    Attributes:
        counters: As given.
        env_steps: Env steps so far.
        rows: For each complete episode an `EpisodeRow` and the value of each counter.
        pauses: Seconds that were not training.
    """

    def __init__(
        self,
        counters: Sequence[str],
        clock: Callable[[], float] = working_time,
    ) -> None:
        self.counters = tuple(counters)
        self._clock = clock
        self._begin = clock()
        self.pauses = 0.0
        self.env_steps = 0
        self.rows: list[tuple[EpisodeRow, tuple[float, ...]]] = []

    @property
    def seconds(self) -> float:
        """Seconds of training."""
        return self._clock() - self._begin - self.pauses

    @contextmanager
    def paused(self) -> Any:
        """Exclude the body from the time of training."""
        begin = self._clock()
        try:
            yield
        finally:
            self.pauses += self._clock() - begin

    def step(self, step: StepRecord) -> None:
        """Log an env step."""
        self.env_steps += 1
        if step.last:
            self._end_episode(step)

    def _end_episode(self, last: StepRecord) -> None:
        info, totals = last.info, last.episode
        counts = totals.decisions.numbers()
        row = EpisodeRow(
            episode=len(self.rows) + 1,
            env_steps=self.env_steps,
            return_=totals.return_,
            learner_return=totals.learner_return,
            length=totals.length,
            terminated=totals.terminated,
            outcome=outcome_of(info),
            unsafe=counts["unsafe_executed"],
            avoidable_unsafe=totals.avoidable_unsafe,
            unsafe_observed=totals.unsafe_observed,
            vetoes=counts["vetoes"],
            planner_steps=counts["planner_steps"],
            seconds=self.seconds,
        )
        self.rows.append((row, tuple(_counted(info, name) for name in self.counters)))


def _counted(info: dict[str, Any], name: str) -> float:
    found = single(info.get(name, 0))
    value = real(int(found) if isinstance(found, bool) else found)
    if value is None:
        raise TaskError(
            f"the task counts `{name}`, but the environment's info has {info[name]!r} there; a "
            "finite number is wanted"
        )
    return float(value)
