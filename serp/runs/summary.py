"""The summary of a run, computed from its metrics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from serp.control.decision_counts import SAFETY, STEPS_BY, sight_of, total

FIRST = 10  # episodes at the beginning of a run
WINDOW = 20  # episodes of the moving mean, also in the learning curve

_FROM_CONFIG = ("domain", "preset", "seed", "learned_from", "file_rewards")
Metrics = Mapping[str, np.ndarray[Any, Any]]
"""Column of ``metrics.csv`` → array ``[episodes]``."""


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
        JSON values. ``return`` and ``domain_return`` hold the mean of all episodes, of the first
        10, of the last 20 and of the best 20 consecutive ones, each null where there are fewer.
        ``shares`` holds actor → share of all steps in which its action was executed; they add up to
        1. ``vetoes_by_reason`` adds up to ``vetoes``. ``sight`` says how far the planner saw, see
        `sight_of`.
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
        "sight": sight_of(counts, steps),
        **(account or {}),
    }
    return summary


def _means(returns: np.ndarray[Any, Any], env_steps: np.ndarray[Any, Any]) -> dict[str, Any]:
    count, best = len(returns), WINDOW - 1
    if count >= WINDOW:
        means = moving_mean(returns)
        best += int(np.argmax(means[best:]))
    return {
        "mean": float(np.mean(returns)) if count else None,
        "first_10": float(np.mean(returns[:FIRST])) if count >= FIRST else None,
        "last_20": float(np.mean(returns[-WINDOW:])) if count >= WINDOW else None,
        "best_20": float(means[best]) if count >= WINDOW else None,
        "best_20_at_env_step": int(env_steps[best]) if count >= WINDOW else None,
    }


def _last(values: np.ndarray[Any, Any]) -> float | None:
    return float(values[-1]) if len(values) and np.isfinite(values[-1]) else None
