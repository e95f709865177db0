"""Curves of a trial, and curves of several seeds on a common grid."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp.comparison.trial_records import Record
from serp.runs.summary import moving_mean

Array = NDArray[np.float64]

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
