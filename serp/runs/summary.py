"""The summary of a run, computed from its metrics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from serp._util.numbers import real
from serp.agent.step_record import SAFETY, STEPS_BY, sight_of, total

FIRST = 10  # episodes at the beginning of a run
WINDOW = 20  # episodes of the moving mean, also in the learning curve

Array = np.ndarray[Any, Any]
Metrics = Mapping[str, Array]
"""Column of ``metrics.csv`` → array ``[episodes]``."""


def moving_mean(values: Array) -> Array:
    """Return the mean over the last `WINDOW` values (over fewer at the beginning), both ``[n]``."""
    sums = np.concatenate([[0.0], np.cumsum(values, dtype=np.float64)])
    ends = np.arange(1, len(values) + 1)
    starts = np.maximum(ends - WINDOW, 0)
    means: Array = (sums[ends] - sums[starts]) / (ends - starts)
    return means


def moving_interval(values: Array) -> tuple[Array, Array]:
    """Return the ends of Student's 95 % interval of each `moving_mean`, ``[n]`` each.

    It is no wider than the values that the mean is of.
    """
    from scipy.special import stdtrit

    if not len(values):
        return np.zeros(0), np.zeros(0)
    counts = np.minimum(np.arange(1, len(values) + 1), WINDOW)
    centre = float(np.mean(values))
    mean, square = moving_mean(values - centre), moving_mean((values - centre) ** 2)
    error = np.sqrt(np.maximum(square - mean**2, 0.0) / np.maximum(counts - 1, 1))
    reach = stdtrit(np.maximum(counts - 1, 1), 0.975) * error
    before = np.full(WINDOW - 1, values[0])
    windows = np.lib.stride_tricks.sliding_window_view(np.concatenate([before, values]), WINDOW)
    return (
        np.maximum(mean + centre - reach, windows.min(axis=1)),
        np.minimum(mean + centre + reach, windows.max(axis=1)),
    )


def binned_shares(metrics: Metrics) -> tuple[Array, dict[str, Array]]:
    """Return the shares of executed actions by actor, in at most 200 bins of episodes.

    Returns:
        The env step in the middle of each bin ``[bins]`` (the outermost ones moved to the ends of
        the run), and actor → share ``[bins]``; the shares add up to 1.
    """
    ends, lengths = metrics["env_steps"], metrics["length"]
    if not len(lengths):
        return np.zeros(0), {actor: np.zeros(0) for actor in STEPS_BY}
    # Bins of equal env steps; an episode belongs to the bin in which it ends.
    width = max(ends[-1] / 200, 1.0)
    _, first = np.unique(np.floor((ends - 1) / width), return_index=True)
    total = np.add.reduceat(lengths, first)
    shares = {
        actor: np.add.reduceat(metrics[name], first) / total for actor, name in STEPS_BY.items()
    }
    last = np.append(first[1:], len(ends)) - 1
    begins = ends[first] - lengths[first]
    centres = (begins + ends[last]) / 2
    centres[0], centres[-1] = begins[0], ends[-1]
    if len(centres) == 1:  # an area needs two corners
        centres = np.array([begins[0], ends[-1]])
        shares = {actor: np.repeat(share, 2) for actor, share in shares.items()}
    return centres, shares


def summarize(
    metrics: Metrics,
    config: Mapping[str, Any] | None = None,
    vetoes_by_reason: Mapping[str, int] | None = None,
    account: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Summarise a run.

    `vetoes_by_reason` are reason → proposals refused for it, `account` is what
    `serp.agent.agent.account_of` returns. It is repeated, as is a part of the configuration.

    Returns:
        JSON values. ``return`` and ``domain_return`` hold the mean of all episodes, of the first
        10, of the last 20 and of the best 20 consecutive ones, each null where there are fewer.
        ``shares`` holds actor → share of all steps in which its action was executed; they add up to
        1. ``vetoes_by_reason`` adds up to ``vetoes``. ``sight`` says how far the
        planner saw, see `sight_of`.
    """
    settings = config or {}
    counts = total(metrics)
    episodes = len(metrics["episode"])
    steps = int(metrics["env_steps"][-1]) if episodes else 0
    seconds = float(metrics["wall_time"][-1]) if episodes else 0.0
    repeated = ("domain", "preset", "seed", "learned_from", "file_rewards")
    return {
        **{key: settings[key] for key in repeated if key in settings},
        "episodes": episodes,
        "env_steps": steps,
        "wall_time": seconds,
        "steps_per_second": steps / seconds if seconds > 0 else None,
        "return": _means(metrics["return"], metrics["env_steps"]),
        "domain_return": _means(metrics["domain_return"], metrics["env_steps"]),
        "terminations": int(metrics["terminated"].sum()),
        "truncations": int(metrics["truncated"].sum()),
        **{name: counts[name] for name in SAFETY},
        "avoidable_unsafe": int(metrics["avoidable_unsafe"].sum()),
        "unsafe_observed": int(metrics["unsafe_observed"].sum()),
        "vetoes_by_reason": dict(vetoes_by_reason or {}),
        "shares": {
            actor: counts[name] / steps if steps else None for actor, name in STEPS_BY.items()
        },
        "final_rho": real(metrics["rho"][-1]) if episodes else None,
        "sight": sight_of(counts, steps),
        **(account or {}),
    }


def _means(returns: Array, env_steps: Array) -> dict[str, Any]:
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
