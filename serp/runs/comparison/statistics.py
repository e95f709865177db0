"""Statistics of a few seeds: interquartile means, bootstrap intervals, censored times.

Agarwal et al., *Deep Reinforcement Learning at the Edge of the Statistical Precipice* (NeurIPS
2021, arXiv:2108.13264), recommend the interquartile mean (mean of the middle half) with percentile
intervals from a bootstrap: it is robust against outliers, and more efficient than the
median.

Values that are NaN were not measured and are left out. Results do not depend on the order of the
seeds. The generator has a fixed seed, so that equal data give equal intervals. The intervals are
those of `scipy.stats.bootstrap`, except that of a median of times (see `times`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import bootstrap, trim_mean

from serp.runs.comparison.plan import Record
from serp.runs.summary import moving_mean

Array = NDArray[np.float64]
Statistic = Callable[[Array], Array]
"""Reduces the last axis of an array."""

CONFIDENCE: Final = 0.95
RESAMPLES: Final = 5_000
CURVE_RESAMPLES: Final = 1_000
_SEED: Final = 0
_MOST_NUMBERS: Final = 10_000_000
"""Numbers that are resampled at once: many seeds would need more memory than there is."""


class Estimate(NamedTuple):
    """A number with its 95 % interval.

    Attributes:
        value: The statistic of the data; NaN where there are none.
        low: Lower end; None where a sample has less than two values, or one of them is infinite.
        high: Upper end; None likewise.
    """

    value: float
    low: float | None
    high: float | None


class Times(NamedTuple):
    """Times until something happened; in some trials it never did.

    Attributes:
        median: Of all trials, with infinity for never; NaN without trials.
        low: Lower end of its 95 % interval; None for fewer than two trials.
        high: Upper end, maybe infinity; None likewise.
        never: Trials in which it never happened.
        trials: How many there are, those with too few episodes to tell left out.
    """

    median: float
    low: float | None
    high: float | None
    never: int
    trials: int


class CurveBand(NamedTuple):
    """A curve with the edges of a band around it, all `[G]`; for one seed they are the curve."""

    centre: Array
    low: Array
    high: Array


def mean(values: Array) -> Array:
    """Return the mean along the last axis; NaN if that is empty."""
    return _reduced(np.mean, values)


def interquartile_mean(values: Array) -> Array:
    """Return the mean of the middle half along the last axis; NaN if that is empty."""
    return _reduced(partial(trim_mean, proportiontocut=0.25), values)


def standard_deviation(values: Array) -> Array:
    """Return the standard deviation (n - 1) along the last axis; 0 for one value, NaN for none."""
    if values.shape[-1] == 1:
        return np.zeros(values.shape[:-1])
    return _reduced(partial(np.std, ddof=1), values)


def median(values: Array) -> float:
    """Return the median; NaN if there are no values."""
    return float(np.median(values)) if len(values) else float("nan")


def _reduced(statistic: Callable[..., Any], values: Array) -> Array:
    if not values.shape[-1]:
        return np.full(values.shape[:-1], np.nan)
    with np.errstate(invalid="ignore"):  # infinities of both signs
        return np.asarray(statistic(values, axis=-1), dtype=np.float64)


def estimate(values: ArrayLike, statistic: Statistic = interquartile_mean) -> Estimate:
    """Estimate a statistic with its bootstrap interval, widened to hold the estimate."""
    return _interval([_sorted(values)], statistic)


def difference(
    first: ArrayLike, second: ArrayLike, statistic: Statistic = interquartile_mean
) -> Estimate:
    """Estimate by how much a statistic of `first` exceeds that of `second`.

    Seeds of both are resampled independently, which is on the safe side where the same seeds of an
    environment make both alike. One value on a side tells nothing of its spread, so that there is
    no interval.
    """
    return _interval(
        [_sorted(first), _sorted(second)], lambda one, other: statistic(one) - statistic(other)
    )


def times(values: ArrayLike) -> Times:
    """Return the median of times, infinity standing for never, with its interval.

    The ends of the interval are medians of resampled trials: scipy's interpolate between two, which
    has no meaning next to infinity.
    """
    found = _sorted(values)
    never = int(np.isinf(found).sum())
    middle = median(found)
    if len(found) < 2:
        return Times(middle, None, None, never, len(found))
    rng = np.random.default_rng(_SEED)
    medians = np.concatenate(
        [
            np.median(found[rng.integers(0, len(found), (rows, len(found)))], axis=-1)
            for rows in _batches(RESAMPLES, len(found))
        ]
    )
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(medians, [tail, 1 - tail], method="inverted_cdf")
    ends = min(float(low), middle), max(float(high), middle)
    return Times(middle, *ends, never, len(found))


def interquartile_band(curves: Array) -> CurveBand:
    """Return the interquartile mean of curves `[seeds, G]` with its pointwise 95 % interval.

    All points use the same resampled seeds.
    """
    across = np.ascontiguousarray(np.sort(curves, axis=0).T)
    centre = interquartile_mean(across)
    if len(curves) < 2:
        return CurveBand(centre, centre, centre)
    low, high = _bootstrap([across], interquartile_mean, CURVE_RESAMPLES)
    return CurveBand(centre, np.minimum(low, centre), np.maximum(high, centre))


def _sorted(values: ArrayLike) -> Array:
    found = np.asarray(values, dtype=np.float64).ravel()
    return np.sort(found[~np.isnan(found)])


def _interval(samples: Sequence[Array], statistic: Callable[..., Array]) -> Estimate:
    with np.errstate(invalid="ignore"):  # infinity less infinity
        value = float(statistic(*samples))
    if any(len(sample) < 2 or not np.isfinite(sample).all() for sample in samples):
        return Estimate(value, None, None)
    low, high = _bootstrap(samples, statistic, RESAMPLES)
    return Estimate(value, min(float(low), value), max(float(high), value))


def _bootstrap(
    samples: Sequence[Array], statistic: Callable[..., Array], resamples: int
) -> tuple[Array, Array]:
    """Return the ends of the percentile interval; seeds are on the last axis."""
    found = bootstrap(
        samples,
        lambda *parts, axis: statistic(*parts),
        n_resamples=resamples,
        batch=next(_batches(resamples, sum(sample.size for sample in samples))),
        vectorized=True,
        paired=False,
        axis=-1,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(_SEED),
    )
    return found.confidence_interval.low, found.confidence_interval.high


def _batches(resamples: int, size: int) -> Iterator[int]:
    """Yield how many resamples of so many numbers are drawn at once, until all are."""
    most = max(1, _MOST_NUMBERS // size)
    for begun in range(0, resamples, most):
        yield min(most, resamples - begun)


GRID: Final = 200
"""Largest number of points of a curve."""


class Curves(NamedTuple):
    """Curves `[seeds, G]` on one grid `[G]`, all finite; no rows if nothing was measured."""

    x: Array
    y: Array


class Checkpoints(NamedTuple):
    """Evaluations of the learner during a training: rising env steps `[C]`, mean returns `[C]`."""

    env_steps: Array
    returns: Array


def checkpoints(record: Record) -> Checkpoints:
    """Return the mean returns of the learner's evaluations; empty where there are none."""
    rows = record.evaluations["policy"] == "learner"
    steps, where = np.unique(record.evaluations["env_steps"][rows], return_inverse=True)
    returns = record.evaluations["return"][rows].astype(np.float64)
    sums = np.bincount(where, weights=returns, minlength=len(steps))
    counts = np.bincount(where, minlength=len(steps))
    return Checkpoints(steps.astype(np.float64), sums / counts)


def running_return(record: Record, at: Array) -> Array:
    """Return the smoothed return of the episode that is running at given env steps.

    Smoothed is the mean over this episode and the 19 before it (over as many as there are).
    Piecewise constant: episode i runs from the step after the end of episode i - 1 to its own
    end. The last complete episode's return is used to the end, as nothing else is known.

    Returns:
        As many returns; NaN where no episode was completed.
    """
    returns = record.episodes["return"].astype(np.float64)
    if not len(returns):
        return np.full(len(at), np.nan)
    running = np.searchsorted(record.episodes["env_steps"], at, side="left")
    return moving_mean(returns)[np.minimum(running, len(returns) - 1)]


def training_curves(records: Sequence[Record], env_steps: int) -> Curves:
    """Return training returns over env steps from 0 to the budget, smoothed over 20 episodes."""
    grid = np.linspace(0, env_steps, GRID)
    rows = [running_return(record, grid) for record in records]
    return _stacked(grid, rows)


def evaluation_curves(records: Sequence[Record]) -> Curves:
    """Return mean returns of the learner alone at all checkpoints, interpolated linearly."""
    found = [points for record in records if len((points := checkpoints(record)).env_steps)]
    if not found:
        return Curves(np.zeros(0), np.zeros((0, 0)))
    grid = np.unique(np.concatenate([points.env_steps for points in found]))
    if len(grid) > GRID:
        grid = np.linspace(grid[0], grid[-1], GRID)
    return _stacked(grid, [np.interp(grid, *points) for points in found])


def _stacked(grid: Array, rows: Sequence[NDArray[Any]]) -> Curves:
    finite = [np.asarray(row, np.float64) for row in rows if np.isfinite(row).all()]
    return Curves(grid, np.stack(finite) if finite else np.zeros((0, len(grid))))
