"""The finished trials of a comparison and their measures."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from serp.comparison.analysis.definitions import BY_NAME, MEASURES, Measure, extra_measures
from serp.comparison.analysis.measures import measure, undecided
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

    Args:
        records: Of finished trials, in any order; some may be missing.
        metadata: The metadata of the comparison.

    Attributes:
        metadata: As given.
        records: In the order of algorithms, variants (the base first) and seeds.
        measured: Trial → name of a measure → value; see `serp.comparison.analysis.measures`.
        undecided: Trial → measures of the threshold that it has too few episodes for.
        missing: Requested trials that are not finished.
    """

    def __init__(self, records: Iterable[Record], metadata: ComparisonMetadata) -> None:
        self.metadata = metadata
        found = {record.trial: record for record in records}
        order = [
            trial
            for algorithm in metadata.algorithms
            for variant in self.variants
            for seed in metadata.seeds
            if (trial := Trial(algorithm, variant, seed)) in found
        ]
        self.records = tuple(found[trial] for trial in order)
        self.measured = {
            trial: measure(found[trial], metadata.protocol.env_steps, metadata.threshold)
            for trial in order
        }
        self.undecided = {trial: undecided(found[trial], metadata.threshold) for trial in order}
        self.missing = tuple(trial for trial in metadata.trials if trial not in found)
        self._estimates: dict[tuple[str, str, str], Estimate] = {}

    @cached_property
    def variants(self) -> tuple[str, ...]:
        """Names of the domain files that were asked for, the base first."""
        others = (name for name in self.metadata.variants if name != self.metadata.base)
        return (self.metadata.base, *others)

    @cached_property
    def algorithms(self) -> tuple[str, ...]:
        """Algorithms with a finished trial on the base variant."""
        return self.on(self.metadata.base)

    def on(self, variant: str) -> tuple[str, ...]:
        """Return the algorithms with a finished trial on a variant, in order."""
        return tuple(dict.fromkeys(t.algorithm for t in self.measured if t.variant == variant))

    def of(self, algorithm: str, variant: str | None = None) -> tuple[Record, ...]:
        """Return the trials of an algorithm on a variant (the base by default), by seed."""
        chosen = self.metadata.base if variant is None else variant
        return tuple(
            record
            for record in self.records
            if record.trial.algorithm == algorithm and record.trial.variant == chosen
        )

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
        return np.array(
            [
                self.measured[record.trial].get(name, absent)
                for record in self.of(algorithm, variant)
            ],
            dtype=np.float64,
        )

    def times(self, algorithm: str, name: str, variant: str | None = None) -> Times:
        """Return the median of a measure that is a time until something, with its interval."""
        few = sum(name in self.undecided[record.trial] for record in self.of(algorithm, variant))
        return times(self.values(algorithm, name, variant), few)

    def caution(self, *variants: str) -> str | None:
        """Return a warning if some variants (the base by default) have few seeds.

        It is shown with all intervals and verdicts.
        """
        counts = {
            (name, variant): len(self.of(name, variant))
            for variant in variants or (self.metadata.base,)
            for name in self.on(variant)
        }
        few = {place: count for place, count in counts.items() if count < ENOUGH}
        if not few:
            return None
        least, most = min(few.values()), max(few.values())
        of = "" if len(few) == len(counts) else f" of {', '.join(dict.fromkeys(n for n, _ in few))}"
        seeds = f"{least}" if least == most else f"{least} to {most}"
        return f"Few seeds ({seeds}{of}): intervals and verdicts are rough. Take at least {ENOUGH}."

    def known(self, algorithm: str, name: str, variant: str | None = None) -> Array:
        """Return the values of a measure for intervals: those that are unknown are left out.

        A time until what never happened counts as the whole training, which favours the trial
        that failed: a difference in favour of another algorithm is at least that large.
        """
        values = self.values(algorithm, name, variant)
        measured = BY_NAME.get(name)
        if measured is not None and measured.time:
            whole: Array | float = float(self.metadata.protocol.env_steps)
            if measured.unit == "episodes":
                whole = self.values(algorithm, "episodes", variant)
            values = np.where(np.isposinf(values), whole, values)
        return values[~np.isnan(values)]

    def estimate(self, algorithm: str, name: str, variant: str | None = None) -> Estimate:
        """Return the interquartile mean of a measure over the seeds, with its 95 % interval."""
        key = (algorithm, name, variant or self.metadata.base)
        if key not in self._estimates:
            self._estimates[key] = estimate([self.known(*key)])
        return self._estimates[key]

    def difference(
        self, first: str, second: str, name: str, statistic: Statistic = mean
    ) -> Estimate:
        """Estimate by how much a measure of one algorithm exceeds another's on the base variant."""
        return difference([self.known(first, name)], [self.known(second, name)], statistic)

    @cached_property
    def range(self) -> float:
        """Largest less smallest return of an episode, of training or evaluation, in any trial."""
        columns = [
            column["return"].astype(np.float64)
            for record in self.records
            for column in (record.episodes, record.evaluations)
        ]
        returns = np.concatenate([np.zeros(0), *columns])
        returns = returns[np.isfinite(returns)]
        return float(np.ptp(returns)) if len(returns) else 0.0
