"""The summary of a run, computed from its metrics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from serp.control.decision_counts import SAFETY, SIGHT, STEPS_BY, total

FIRST = 10  # episodes at the beginning of a run
WINDOW = 20  # episodes of the moving mean, also in the learning curve

_FROM_CONFIG = ("domain", "preset", "seed", "learned_from", "file_rewards")
Metrics = Mapping[str, np.ndarray[Any, Any]]
"""Column of ``metrics.csv`` → array ``[episodes]``."""


def spans(episodes: int) -> tuple[int, int]:
    """Return the numbers of episodes that ``first_10`` and ``last_20`` of a summary average."""
    return min(FIRST, episodes), min(WINDOW, episodes)


def moving_mean(values: np.ndarray[Any, Any]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the mean over the last `WINDOW` values (over fewer at the beginning), both ``[n]``."""
    sums = np.concatenate([[0.0], np.cumsum(values, dtype=np.float64)])
    ends = np.arange(1, len(values) + 1)
    starts = np.maximum(ends - WINDOW, 0)
    means: np.ndarray[tuple[int], np.dtype[np.float64]] = (sums[ends] - sums[starts]) / (
        ends - starts
    )
    return means


def summarize(
    metrics: Metrics,
    config: Mapping[str, Any] | None = None,
    vetoes_by_reason: Mapping[str, int] | None = None,
    compile_seconds: float = 0.0,
    account: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Summarise a run.

    Args:
        metrics: What `serp.runs.reading.read_metrics` returns.
        config: The resolved configuration, a part of which is repeated.
        vetoes_by_reason: Reason → proposals refused for it, in the order of the report.
        compile_seconds: Seconds of compilation, which are not part of ``wall_time``.
        account: What `serp.training.account.account_of` returns, which is repeated.

    Returns:
        JSON values. ``return`` and ``domain_return`` hold the mean of the first 10, of the last 20
        and of the best 20 consecutive episodes (of all if there are fewer), all null before the
        first episode. ``shares`` holds actor → share of all steps in which its action was executed;
        they add up to 1. ``vetoes_by_reason`` adds up to ``vetoes``. ``sight`` says how far the
        planner saw, see `_sight`.
    """
    settings = config or {}
    counts = total(metrics)
    episodes = len(metrics["episode"])
    steps = int(metrics["env_steps"][-1]) if episodes else 0
    seconds = float(metrics["wall_time"][-1]) if episodes else 0.0
    summary: dict[str, Any] = {key: settings[key] for key in _FROM_CONFIG if key in settings}
    summary |= {
        "episodes": episodes,
        "env_steps": steps,
        "wall_time": seconds,
        "compile_seconds": compile_seconds,
        "steps_per_second": steps / seconds if seconds > 0 else None,
        "return": _means(metrics["return"], metrics["env_steps"]),
        "domain_return": _means(metrics["domain_return"], metrics["env_steps"]),
        "terminations": int(metrics["terminated"].sum()),
        "truncations": int(metrics["truncated"].sum()),
        **{name: counts[name] for name in SAFETY},
        "vetoes_by_reason": dict(vetoes_by_reason or {}),
        "shares": {
            actor: counts[name] / steps if steps else None for actor, name in STEPS_BY.items()
        },
        "final_rho": _last(metrics["rho"]),
        "sight": _sight(counts, steps),
        **(account or {}),
    }
    return summary


def _sight(counts: Mapping[str, int], steps: int) -> dict[str, float | None]:
    """Return how far the planner saw.

    The shares of all steps in which it saw everything that can be reached, in which values of cells
    stood for what lies beyond the layers that it saw, in which a budget cut it short, and in which
    it had no reason to prefer one action; and the mean number of layers that it saw in the steps in
    which it did not see everything.
    """
    shares = {name: counts[name] / steps if steps else None for name in SIGHT}
    partial = steps - counts["saw_all"]
    return {**shares, "mean_depth": counts["layers_seen"] / partial if partial else None}


def _means(returns: np.ndarray[Any, Any], env_steps: np.ndarray[Any, Any]) -> dict[str, Any]:
    if not len(returns):
        return {"first_10": None, "last_20": None, "best_20": None, "best_20_at_env_step": None}
    # A mean over fewer episodes than the window is not a candidate for the best one.
    full = min(WINDOW, len(returns)) - 1
    means = moving_mean(returns)
    best = full + int(np.argmax(means[full:]))
    return {
        "first_10": float(np.mean(returns[:FIRST])),
        "last_20": float(np.mean(returns[-WINDOW:])),
        "best_20": float(means[best]),
        "best_20_at_env_step": int(env_steps[best]),
    }


def _last(values: np.ndarray[Any, Any]) -> float | None:
    return float(values[-1]) if len(values) and np.isfinite(values[-1]) else None
