"""The measures of trials, and their statistics over a few seeds.

Agarwal et al., *Deep Reinforcement Learning at the Edge of the Statistical Precipice* (NeurIPS
2021, arXiv:2108.13264), recommend the interquartile mean (mean of the middle half) with percentile
intervals from a bootstrap: it is robust against outliers, and more efficient than the median.

The generator has a fixed seed, so that equal data give equal intervals.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import trapezoid
from scipy.stats import bootstrap, trim_mean

from serp._util.text import plural, readable
from serp.runs.comparison.trial import Record, Trial
from serp.runs.summary import WINDOW, moving_mean

if TYPE_CHECKING:
    from serp.runs.comparison.compare import ComparisonPlan

Array = NDArray[np.float64]

RESAMPLES: Final = 5_000
ENOUGH: Final = 5  # seeds below which intervals are rough; they tend to be too narrow
GRID: Final = 200  # points of a training curve


class Measure(NamedTuple):
    """One measure: its column in `measures.csv`, its title in tables, its definition."""

    name: str
    title: str
    meaning: str
    better: Literal["higher", "lower"] | None
    table: Literal["returns", "safety", "task"]
    compared: bool = False  # whether the report has the differences between algorithms


# fmt: off
MEASURES: Final = (
    Measure("training_area", "area under the training curve",
            "Return of the current training episode, averaged over the env steps of the budget. "
            "The return of the last complete episode counts until the end of the budget.",
            "higher", "returns", True),
    Measure("first_50", "first 50 episodes",
            "Mean return of the first 50 training episodes (of all, if there are fewer).",
            "higher", "returns", True),
    Measure("last_20", f"last {WINDOW} episodes",
            f"Mean return of the last {WINDOW} training episodes (of all, if there are fewer).",
            "higher", "returns", True),
    Measure("threshold_env_steps", "env steps to the return threshold",
            f"Env steps until the mean return of {WINDOW} training episodes in a row first reaches "
            "the threshold. If it is never reached, statistics use the whole budget. With fewer "
            f"than {WINDOW} episodes, there is no value.",
            "lower", "returns", True),
    Measure("learner_area", "area under the learner's curve",
            "Return of the learner alone (greedy, without planner and vetoes), averaged over the "
            "env steps of the budget; interpolated between evaluations. Before the first "
            "evaluation, the value of the first one is used.",
            "higher", "returns", True),
    Measure("final_learner", "final learner alone",
            "Mean return of the learner alone (greedy, no planner, no veto) after training.",
            "higher", "returns", True),
    Measure("final_policy", "final policy",
            "Mean return of the trained policy: the strategy's choice within the vetoes. If an "
            "algorithm has only a planner or only a learner, that one acts alone.",
            "higher", "returns", True),
    Measure("unsafe", "unsafe executed",
            "Actions that the domain file flags unsafe, executed in training.",
            "lower", "safety", True),
    Measure("avoidable_unsafe", "avoidable unsafe executed",
            "Flagged actions executed in training while another action was not flagged.",
            "lower", "safety"),
    Measure("unsafe_observed", "observed unsafe",
            "Training steps that were observed unsafe, predicted or not.",
            "lower", "safety"),
    Measure("final_unsafe_observed", "observed unsafe, final policy",
            "Mean number of steps observed unsafe in an episode of the final policy.",
            "lower", "safety"),
    Measure("terminated", "terminated episodes",
            "Training episodes that the environment ended, not a time limit.",
            None, "safety"),
    Measure("vetoes", "vetoes", "Proposals refused in training.", None, "safety"),
    Measure("planner_share", "planner's share",
            "Share of the env steps in which the planner's action was executed.", None, "safety"),
    Measure("seconds_per_1000", "seconds per 1,000 env steps",
            "Wall time of training without evaluations.", "lower", "safety"),
)
"""All measures that every trial has, in the order in which they are reported."""
# fmt: on


def _task_measure(name: str) -> Measure:
    """Return the measure of an outcome, or of a counter of the environment."""
    kind, _, what = name.partition(".")
    if kind == "outcome":
        meaning = f"Share of the final policy's episodes that ended with the outcome “{what}”."
        return Measure(name, f"outcome {what}", meaning, None, "task")
    meaning = f"Mean of the environment's “{what}” at the ends of the final policy's episodes."
    return Measure(name, what, meaning, None, "task")


def measure(record: Record, env_steps: int, threshold: float | None) -> dict[str, float]:
    """Return every measure of a trial.

    Returns:
        Every name of `MEASURES`, then `outcome.<name>` and `info.<name>`, if there are any. NaN
        where nothing was measured or there are too few episodes, infinity for the time until a
        threshold that was never reached.
    """
    episodes = record.episodes
    returns, ends = episodes["return"], episodes["env_steps"].astype(np.float64)
    steps = float(episodes["length"].sum())
    final = _final(record, "policy") or _final(record, "learner")
    begins = np.array([0.0, *ends[:-1], env_steps])  # the return of the last episode goes on
    at, worth = evaluation_curve(record)
    grid = np.unique([0.0, *at, env_steps])
    area = trapezoid(np.interp(grid, at, worth), grid) / env_steps if len(at) else np.nan
    values = {
        "training_area": np.diff(begins) @ returns / env_steps if steps else np.nan,
        "first_50": _mean(returns[:50]),
        "last_20": _mean(returns[-WINDOW:]),
        "threshold_env_steps": _until(ends, returns, threshold),
        "learner_area": area,
        "final_learner": _final(record, "learner").get("return", np.nan),
        "final_policy": final.get("return", np.nan),
        "unsafe": episodes["unsafe_executed"].sum(),
        "avoidable_unsafe": episodes["avoidable_unsafe"].sum(),
        "unsafe_observed": episodes["unsafe_observed"].sum(),
        "final_unsafe_observed": final.get("unsafe_observed", np.nan),
        "terminated": episodes["terminated"].sum(),
        "vetoes": episodes["vetoes"].sum(),
        "planner_share": episodes["planner_steps"].sum() / steps if steps else np.nan,
        "seconds_per_1000": 1_000 * episodes["wall_time"][-1] / ends[-1] if steps else np.nan,
        **{name: value for name, value in final.items() if "." in name},
    }
    return {name: float(value) for name, value in values.items()}


def _until(ends: Array, returns: Array, threshold: float | None) -> float:
    """Return when a whole window of episodes first reached the threshold."""
    if threshold is None or len(returns) < WINDOW:
        return float("nan")
    good = np.flatnonzero(moving_mean(returns)[WINDOW - 1 :] >= threshold)
    return float(ends[int(good[0]) + WINDOW - 1]) if len(good) else float("inf")


def _final(record: Record, policy: str) -> dict[str, float]:
    """Return column → mean over the episodes of a policy's last evaluation, and its outcomes."""
    table = record.evaluations
    rows = table["policy"] == policy
    if not rows.any():
        return {}
    rows &= table["env_steps"] == table["env_steps"][rows].max()
    means = {k: _mean(column[rows]) for k, column in table.items() if column.dtype.kind == "f"}
    for name in sorted({*table["outcome"][rows].tolist()} - {""}):
        means[f"outcome.{name}"] = _mean(table["outcome"][rows] == name)
    return means


def _mean(values: NDArray[Any]) -> float:
    return float(values.mean()) if len(values) else float("nan")


class Estimate(NamedTuple):
    """A number, NaN without data, and its 95 % interval; None of less than two values."""

    value: float
    low: float | None
    high: float | None


def interquartile_mean(values: Array) -> Array:
    """Return the mean of the middle half along the last axis; NaN if that is empty."""
    if not values.shape[-1]:
        return np.full(values.shape[:-1], np.nan)
    return np.asarray(trim_mean(values, 0.25, axis=-1), dtype=np.float64)


def estimate(values: ArrayLike, less: ArrayLike | None = None) -> Estimate:
    """Return the interquartile mean with its bootstrap interval, widened to hold the mean.

    With `less`, by how much it exceeds that of `less`. Both are resampled independently, which is
    on the safe side where the same seeds of an environment make both alike. The order of values
    does not matter.
    """
    samples = [np.sort(np.asarray(part, np.float64)) for part in (values, less) if part is not None]
    value, low, high = map(float, _with_interval(*samples))
    known = all(len(sample) > 1 for sample in samples)
    return Estimate(value, low if known else None, high if known else None)


def _excess(sample: Array, less: Array | None = None) -> Array:
    mean = interquartile_mean(sample)
    return mean if less is None else mean - interquartile_mean(less)


def _with_interval(*samples: Array) -> tuple[Array, Array, Array]:
    """Return the statistic and its percentile interval, [value, value] of less than two seeds."""
    value, size = _excess(*samples), sum(sample.size for sample in samples)
    if any(sample.shape[-1] < 2 for sample in samples):
        return value, value, value
    # Numbers that are resampled at once: many seeds would need more memory than there is.
    ends = bootstrap(
        samples,
        lambda *parts, axis: _excess(*parts),
        n_resamples=RESAMPLES,
        batch=min(RESAMPLES, max(1, 10_000_000 // size)),
        vectorized=True,
        paired=False,
        axis=-1,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    return value, np.minimum(ends.low, value), np.maximum(ends.high, value)


class Curves(NamedTuple):
    """Curves `[seeds, G]` on one grid `[G]`, all finite; no rows if nothing was measured."""

    x: Array
    y: Array

    def band(self) -> tuple[Array, Array, Array]:
        """Return the interquartile mean and the ends of its pointwise 95 % interval, all `[G]`."""
        return _with_interval(np.ascontiguousarray(np.sort(self.y, axis=0).T))


def evaluation_curve(record: Record) -> tuple[Array, Array]:
    """Return env steps and mean return of the evaluations of the learner; empty without any."""
    rows = record.evaluations["policy"] == "learner"
    steps, where = np.unique(record.evaluations["env_steps"][rows], return_inverse=True)
    returns = record.evaluations["return"][rows]
    return steps, np.bincount(where, weights=returns) / np.bincount(where)


def training_curves(records: Iterable[Record], env_steps: int) -> Curves:
    """Return training returns, the moving mean of the running episode, from 0 to the budget."""
    grid, rows = np.linspace(0, env_steps, GRID), []
    for record in records:
        returns, ends = record.episodes["return"], record.episodes["env_steps"]
        if len(returns):
            running = np.minimum(np.searchsorted(ends, grid), len(returns) - 1)
            rows.append(moving_mean(returns)[running])
    return Curves(grid, np.array(rows).reshape(len(rows), GRID))


def evaluation_curves(records: Iterable[Record]) -> Curves:
    """Return mean returns of the learner alone at the evaluations, which all trials have alike."""
    curves = [curve for record in records if len((curve := evaluation_curve(record))[0])]
    grid = curves[0][0] if curves else np.zeros(0)
    return Curves(grid, np.array([y for _, y in curves]).reshape(len(curves), len(grid)))


class Results:
    """Complete trials, in the order of algorithms and seeds, and their measures.

    Attributes:
        algorithms: Names of the algorithms with a complete trial, in order.
        measured: Trial → name of a measure → value.
        measures: Those that every trial has, then the task's own.
    """

    def __init__(self, records: Iterable[Record], plan: ComparisonPlan) -> None:
        self.plan = plan
        self.records = sorted(
            records, key=lambda r: (plan.algorithms.index(r.trial.algorithm), r.trial.seed)
        )
        self.algorithms = list(dict.fromkeys(r.trial.algorithm for r in self.records))
        self.measured: dict[Trial, dict[str, float]] = {
            record.trial: measure(record, plan.protocol.env_steps, plan.threshold)
            for record in self.records
        }
        own = {name for values in self.measured.values() for name in values if "." in name}
        self.measures = MEASURES + tuple(map(_task_measure, sorted(own)))

    def of(self, algorithm: str) -> list[Record]:
        """Return the trials of an algorithm, by seed."""
        return [record for record in self.records if record.trial.algorithm == algorithm]

    @property
    def caution(self) -> str | None:
        """A warning of too few seeds; None if there are enough. It is shown with intervals."""
        fewest = min((len(self.of(name)) for name in self.algorithms), default=ENOUGH)
        if fewest >= ENOUGH:
            return None
        return f"Few seeds ({fewest}): intervals are rough. Use at least {ENOUGH}."

    @property
    def rewards(self) -> list[str]:
        """What the learners learn from; where that differs, of each algorithm."""
        learned = {record.trial.algorithm: record.reward for record in self.records}
        same = {f"The learner learns from {reward}." for reward in learned.values()}
        return [*same] if len(same) == 1 else [f"{name}: {learned[name]}." for name in learned]

    @property
    def verdicts(self) -> list[str]:
        """Whether the training returns of the others differ from those of the first algorithm."""
        first, lines = self.algorithms[0] if self.algorithms else "", []
        for other in self.algorithms[1:]:
            found = self.estimate("training_area", first, other)
            few, most = sorted(len(self.known(name, "training_area")) for name in (first, other))
            count = plural(few, "seed")
            if found.low is None or found.high is None:
                lines.append(f"{count}: too few to tell {first} and {other} apart.")
                continue
            ends = f"difference {readable(found.value)}, 95 % interval {readable(found.low)} to "
            ends += f"{readable(found.high)}, "
            ends += f"{count} each" if few == most else f"{few} and {most} seeds"
            if found.low <= 0.0 <= found.high:
                lines.append(f"{first} and {other}: no clear difference in training ({ends}).")
            else:
                word = "higher" if found.value > 0 else "lower"
                lines.append(f"{first} has a {word} return than {other} in training ({ends}).")
        return [*lines, *([self.caution] if self.caution else [])]

    def values(self, algorithm: str, name: str) -> Array:
        """Return a measure of every trial, by seed; 0 for an outcome that never came."""
        absent = 0.0 if name.startswith("outcome.") else np.nan
        trials = (record.trial for record in self.of(algorithm))
        return np.array([self.measured[trial].get(name, absent) for trial in trials], np.float64)

    def known(self, algorithm: str, name: str) -> Array:
        """Return the values of a measure for intervals, without those that are unknown.

        The time until a threshold that was never reached counts as the whole budget: a difference
        in favour of an algorithm that reached it is at least that large.
        """
        values = self.values(algorithm, name)
        values = np.where(np.isposinf(values), float(self.plan.protocol.env_steps), values)
        return values[~np.isnan(values)]

    def estimate(self, name: str, algorithm: str, less: str | None = None) -> Estimate:
        """Estimate a measure of an algorithm or, with `less`, how much it exceeds another's."""
        other = None if less is None else self.known(less, name)
        return estimate(self.known(algorithm, name), other)
