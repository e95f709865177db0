"""The values of all measures of a trial; `serp.comparison.analysis.definitions` defines them."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from serp.comparison.analysis.curves import Checkpoints, checkpoints
from serp.comparison.trial_records import Record
from serp.runs.summary import WINDOW, moving_mean

Array = NDArray[np.float64]

NEVER: Final = float("inf")
"""The value of a time until something that did not happen."""


def measure(record: Record, env_steps: int, threshold: float | None) -> dict[str, float]:
    """Return every measure of a trial.

    Returns:
        Every name of `serp.comparison.analysis.definitions.MEASURES`, then `outcome.<name>` and
        `info.<name>`, if there are any. NaN where nothing was measured or there are too few
        episodes, infinity for times until what never happened.
    """
    episodes = record.episodes
    returns = episodes["return"].astype(np.float64)
    ends = episodes["env_steps"].astype(np.float64)
    learner = checkpoints(record)
    steps = float(episodes["length"].sum())
    seconds = float((record.metadata.get("seconds") or {}).get("training", np.nan))
    values = {
        "training_area": training_area(ends, returns, env_steps),
        "learner_area": learner_area(learner, env_steps),
        "first_10": _mean(returns[:10]),
        "first_50": _mean(returns[:50]),
        "last_20": _mean(returns[-WINDOW:]),
        **_training_threshold(ends, returns, threshold),
        **_learner_threshold(record, learner, threshold),
        "final_learner": _final(record, "learner", "return"),
        "final_vetoed": _final(record, "vetoed", "return"),
        "planner": _final(record, "planner", "return"),
        **_lead(record),
        "episodes": float(len(returns)),
        "terminated": float(episodes["terminated"].sum()),
        "unsafe": float(episodes["unsafe"].sum()),
        "avoidable_unsafe": float(episodes["avoidable_unsafe"].sum()),
        "unsafe_observed": float(episodes["unsafe_observed"].sum()),
        "final_learner_unsafe": _final(record, "learner", "unsafe"),
        "final_vetoed_unsafe": _final(record, "vetoed", "unsafe"),
        "final_learner_unsafe_observed": _final(record, "learner", "unsafe_observed"),
        "final_vetoed_unsafe_observed": _final(record, "vetoed", "unsafe_observed"),
        "vetoes": float(episodes["vetoes"].sum()),
        "planner_share": float(episodes["planner_steps"].sum()) / steps if steps else np.nan,
        "seconds": seconds,
        "seconds_per_1000": 1_000 * seconds / ends[-1] if len(ends) else np.nan,
    }
    names, counts = np.unique(episodes["outcome"].astype(str), return_counts=True)
    for name, count in zip(names.tolist(), counts.tolist(), strict=True):
        if name:
            values[f"outcome.{name}"] = float(count)
    for name, column in episodes.items():
        if name.startswith("info."):
            values[name] = float(np.nansum(column.astype(np.float64)))
    return {name: float(value) for name, value in values.items()}


def training_area(ends: Array, returns: Array, env_steps: int) -> float:
    """Return the time average over a budget of the return of the running episode."""
    if not len(returns) or env_steps <= 0:
        return float("nan")
    edges = np.concatenate([[0.0], np.minimum(ends, env_steps)])
    edges[-1] = env_steps  # the last episode goes on, or its rest is beyond the budget
    return float(np.diff(edges) @ returns) / env_steps


def learner_area(points: Checkpoints, env_steps: int) -> float:
    """Return the area under a curve of evaluations, divided by the budget."""
    if not len(points.env_steps) or env_steps <= 0:
        return float("nan")
    inside = (points.env_steps > 0) & (points.env_steps < env_steps)
    grid = np.concatenate([[0.0], points.env_steps[inside], [float(env_steps)]])
    heights = np.interp(grid, *points)
    return float(np.diff(grid) @ (heights[1:] + heights[:-1])) / 2 / env_steps


# A few episodes do not show that a policy is good, nor that it never is.


def _training_threshold(ends: Array, returns: Array, threshold: float | None) -> dict[str, float]:
    steps, episode = np.nan, np.nan
    if threshold is not None and len(returns) >= WINDOW:
        good = np.flatnonzero(moving_mean(returns)[WINDOW - 1 :] >= threshold)  # whole windows only
        episode = float(good[0] + WINDOW) if len(good) else NEVER
        steps = float(ends[int(good[0]) + WINDOW - 1]) if len(good) else NEVER
    return {"threshold_env_steps": steps, "threshold_episodes": episode}


def _learner_threshold(
    record: Record, points: Checkpoints, threshold: float | None
) -> dict[str, float]:
    steps, held = np.nan, np.nan
    if threshold is not None and (record.evaluations["policy"] == "learner").sum() >= WINDOW:
        good = points.returns >= threshold
        first = int(np.argmax(good))
        steps = float(points.env_steps[first]) if good.any() else NEVER
        held = _mean(good[first + 1 :].astype(np.float64)) if good.any() else np.nan
    return {"learner_threshold_env_steps": steps, "learner_threshold_held": held}


def _lead(record: Record) -> dict[str, float]:
    """Return who leads after training, and the evidence for it."""
    lead = record.metadata.get("lead") or {}
    evidence = lead.get("evidence") or {}
    worth = {f"{who}_led": evidence.get(who) or {} for who in ("planner", "learner")}
    values = {name: float(each.get("mean", np.nan)) for name, each in worth.items()}
    return {"rho": float(lead.get("rho", np.nan)), **values}


def _final(record: Record, policy: str, column: str) -> float:
    """Return the mean over the episodes of a policy's last evaluation."""
    evaluations = record.evaluations
    rows = evaluations["policy"] == policy
    if not rows.any():
        return float("nan")
    rows &= evaluations["env_steps"] == evaluations["env_steps"][rows].max()
    return _mean(evaluations[column][rows].astype(np.float64))


def _mean(values: Array) -> float:
    return float(values.mean()) if len(values) else float("nan")
