"""The learning curve of a run as arrays, and the planner's return as what it is compared with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.text import plural
from serp.errors import RunError, SerpError
from serp.report.recorded_steps import RecordedEpisode
from serp.runs.recording import evaluations_of, open_recording
from serp.runs.summary import Metrics, binned_shares, moving_interval, moving_mean
from serp.training.evaluation import interval_of
from serp.training.run import Run

_MOST: Final = 3_000
"""Most episodes that are drawn one by one; of more, evenly spread ones are."""
_POINTS: Final = 600
"""Most points of the mean."""


def curve_arrays(metrics: Metrics, recorded: Sequence[RecordedEpisode]) -> dict[str, NDArray[Any]]:
    """Return what the page draws: the returns, their moving mean with its interval, the shares.

    Args:
        metrics: The metrics, whose episodes are numbered as they end.
        recorded: The recorded episodes of the training, which are numbered as they begin.
    """
    ended = [each for each in recorded if each.end != "unfinished"]
    ended.sort(key=lambda each: int(each.positions[-1]))
    numbers = np.zeros(len(metrics["episode"]), np.uint32)  # 0: not recorded
    known = min(len(ended), len(numbers))
    numbers[:known] = [each.number for each in ended[:known]]
    steps, returns = metrics["env_steps"], metrics["return"]
    drawn, points = _spread(len(returns), _MOST), _spread(len(returns), _POINTS)
    mean, (low, high) = moving_mean(returns), moving_interval(returns)
    at, shares = binned_shares(metrics)
    return {
        "curveAt": steps[drawn],
        "curveReturns": returns[drawn],
        "curveNumbers": metrics["episode"][drawn].astype(np.uint32),
        "curveEpisodes": numbers[drawn],
        "meanAt": steps[points],
        "mean": mean[points],
        "meanLow": low[points],
        "meanHigh": high[points],
        "rho": np.nan_to_num(metrics["rho"])[points],
        "shareAt": at,
        "shares": np.array(list(shares.values())),
    }


def _spread(count: int, most: int) -> NDArray[np.int64]:
    """Return evenly spread positions, the first and the last among them."""
    return np.unique(np.linspace(0, max(0, count - 1), min(count, most)).astype(np.int64))


def planner_baseline(run: Run, episodes: int) -> tuple[dict[str, Any] | None, list[str]]:
    """Return the planner's mean return: `mean`, `low`, `high` and a `label`; and what was left out.

    It is that of the recorded evaluation with the most episodes; without one the planner is
    evaluated now, for some episodes (None if for 0). What cannot be read or evaluated is left out,
    for the rest of a report does not need it.
    """
    found: dict[str, list[float]] = {}
    notes: list[str] = []
    for name in evaluations_of(run.path):
        try:
            recording = open_recording(run.path, name)
            if recording.layout.policy == "planner":
                rewards = recording.columns("env_reward")["env_reward"]
                found[name] = [float(rewards[own].sum()) for own in recording.episodes.values()]
        except RunError as error:
            notes.append(f"The evaluation {name} was left out: {error}")
    best = max(found, key=lambda name: len(found[name]), default="")
    if best and found[best]:
        returns, origin = found[best], f"evaluation {best}"
    else:
        try:
            returns = list(run.evaluate("planner", episodes=episodes).returns) if episodes else []
        except SerpError as error:  # no checkpoint, or no environment
            returns = []
            notes.append(f"The planner alone was not evaluated: {error}")
        origin = "evaluated for this report"
    if not returns:
        return None, notes
    mean = float(np.mean(returns))
    low, high = interval_of(returns) or (mean, mean)
    count = plural(len(returns), "episode")
    label = f"the planner alone, mean of {count} with its 95 % interval ({origin})"
    return {"mean": mean, "low": low, "high": high, "label": label}, notes
