"""The finished trials of a comparison and their measures."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from serp.comparison.analysis.definitions import BY_NAME, MEASURES, Measure, extra_measures
from serp.comparison.analysis.measures import measure
from serp.comparison.analysis.statistics import (
    Estimate,
    Statistic,
    Times,
    difference,
    estimate,
    mean,
    times,
)
from serp.comparison.metadata import ComparisonMetadata
from serp.comparison.trial_records import Record, Trial

Array = NDArray[np.float64]

ENOUGH: Final = 5
"""Number of seeds below which intervals are rough; they tend to be too narrow."""


class Results:
    """Finished trials, in the order of the tables, and their measures.

    Methods that take a variant use the base by default.

    Attributes:
        metadata: As given.
        plan: That of the metadata.
        records: In the order of algorithms, variants (the base first) and seeds.
        measured: Trial → name of a measure → value; see `serp.comparison.analysis.measures`.
        missing: Requested trials that are not finished.
    """

    def __init__(self, records: Iterable[Record], metadata: ComparisonMetadata) -> None:
        self.metadata = metadata
        self.plan = plan = metadata.plan
        found = {record.trial: record for record in records}
        algorithms, variants = list(plan.algorithms), list(plan.variants)

        def place(trial: Trial) -> tuple[int, int, int]:
            return algorithms.index(trial.algorithm), variants.index(trial.variant), trial.seed

        self.records = tuple(found[trial] for trial in sorted(found, key=place))
        self.measured = {
            record.trial: measure(record, plan.protocol.env_steps, plan.threshold)
            for record in self.records
        }
        self.missing = tuple(trial for trial in plan.trials if trial not in found)
        self._estimates: dict[tuple[str, str, str], Estimate] = {}

    @cached_property
    def algorithms(self) -> tuple[str, ...]:
        """Algorithms with a finished trial on the base variant."""
        return self.on(self.plan.base)

    def on(self, variant: str) -> tuple[str, ...]:
        """Return the algorithms with a finished trial on a variant, in order."""
        return tuple(dict.fromkeys(t.algorithm for t in self.measured if t.variant == variant))

    def of(self, algorithm: str, variant: str | None = None) -> tuple[Record, ...]:
        """Return the trials of an algorithm on a variant, by seed."""
        key = (algorithm, variant or self.plan.base)
        return tuple(record for record in self.records if record.trial[:2] == key)

    @cached_property
    def table(self) -> tuple[Measure, ...]:
        """All measures of this comparison: those that every trial has, then the task's own."""
        return MEASURES + extra_measures(
            name for values in self.measured.values() for name in values
        )

    def values(self, algorithm: str, name: str, variant: str | None = None) -> Array:
        """Return a measure of every trial of an algorithm on a variant, by seed.

        An outcome that a trial never had counts 0; NaN is what was not measured.
        """
        absent = 0.0 if name.startswith("outcome.") else np.nan
        trials = (record.trial for record in self.of(algorithm, variant))
        return np.array([self.measured[trial].get(name, absent) for trial in trials], np.float64)

    def times(self, algorithm: str, name: str, variant: str | None = None) -> Times:
        """Return the median of a measure that is a time until something, with its interval."""
        return times(self.values(algorithm, name, variant))

    @cached_property
    def caution(self) -> str | None:
        """A warning of too few seeds; None if there are enough. It is shown with intervals."""
        counts = [len(self.of(name, v)) for v in self.plan.variants for name in self.on(v)]
        few = sorted(count for count in counts if count < ENOUGH)
        if not few:
            return None
        seeds = f"{few[0]}" if few[0] == few[-1] else f"{few[0]} to {few[-1]}"
        return f"Few seeds ({seeds}): intervals are rough. Take at least {ENOUGH}."

    def known(self, algorithm: str, name: str, variant: str | None = None) -> Array:
        """Return the values of a measure for intervals: those that are unknown are left out.

        A time until what never happened counts as the whole training, which favours the trial
        that failed: a difference in favour of another algorithm is at least that large.
        """
        values = self.values(algorithm, name, variant)
        measured = BY_NAME.get(name)
        if measured is not None and measured.time:
            whole: Array | float = float(self.plan.protocol.env_steps)
            if measured.unit == "episodes":
                whole = self.values(algorithm, "episodes", variant)
            values = np.where(np.isposinf(values), whole, values)
        return values[~np.isnan(values)]

    def estimate(self, algorithm: str, name: str, variant: str | None = None) -> Estimate:
        """Return the interquartile mean of a measure over the seeds, with its 95 % interval."""
        key = (algorithm, name, variant or self.plan.base)
        if key not in self._estimates:
            self._estimates[key] = estimate(self.known(*key))
        return self._estimates[key]

    def difference(
        self, first: str, second: str, name: str, statistic: Statistic = mean
    ) -> Estimate:
        """Estimate by how much a measure of one algorithm exceeds another's on the base variant."""
        return difference(self.known(first, name), self.known(second, name), statistic)

    @cached_property
    def range(self) -> float:
        """Largest less smallest return of an episode, of training or evaluation, in any trial."""
        tables = [
            table for record in self.records for table in (record.episodes, record.evaluations)
        ]
        returns = np.concatenate([np.zeros(0), *(table["return"] for table in tables)])
        returns = returns[np.isfinite(returns)]
        return float(np.ptp(returns)) if len(returns) else 0.0
