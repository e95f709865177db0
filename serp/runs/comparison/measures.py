"""The values of all measures of a trial; `serp.runs.comparison.measures` defines them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp.runs.comparison.algorithms import DQN, PLANNER, SERP
from serp.runs.comparison.plan import Record, Trial
from serp.runs.comparison.request import ComparisonMetadata
from serp.runs.comparison.statistics import (
    Checkpoints,
    Estimate,
    Statistic,
    Times,
    checkpoints,
    difference,
    estimate,
    mean,
    times,
)
from serp.runs.summary import WINDOW, moving_mean


class Measure(NamedTuple):
    """One measure.

    Attributes:
        name: Its column in `measures.csv`.
        title: In tables, short.
        meaning: Its definition, in a sentence or two.
        unit: `return`, `env steps`, `episodes`, `steps`, `seconds`, `share` or `count`.
        better: Which way is better; None where neither is.
        table: The table of the report that has it: `returns`, `lead`, `times`, `safety` or `cost`.
        compared: Whether the report has the differences between algorithms.
    """

    name: str
    title: str
    meaning: str
    unit: str
    better: Literal["higher", "lower"] | None
    table: Literal["returns", "lead", "times", "safety", "cost"]
    compared: bool = False

    @property
    def time(self) -> bool:
        """Whether it is a time until something, infinite where that never happened."""
        return self.table == "times" and self.unit != "share"


# fmt: off
MEASURES: Final = (
    Measure("training_area", "area under the training curve",
            "Time average, over the budget, of the return of the running training episode; the "
            "last complete episode's return goes on to the end of the budget.",
            "return", "higher", "returns", True),
    Measure("learner_area", "area under the learner's curve",
            "Time average, over the budget, of the mean returns of the learner alone (greedy, no "
            "planner, no veto), linear between evaluations and constant before and after them.",
            "return", "higher", "returns", True),
    Measure("first_10", "first 10 episodes",
            "Mean return of the first 10 training episodes (of all, where there are fewer).",
            "return", "higher", "returns", True),
    Measure("first_50", "first 50 episodes",
            "Mean return of the first 50 training episodes (of all, where there are fewer).",
            "return", "higher", "returns", True),
    Measure("last_20", "last 20 episodes",
            "Mean return of the last 20 training episodes (of all, where there are fewer).",
            "return", "higher", "returns", True),
    Measure("threshold_env_steps", "env steps to the threshold",
            "Env steps until the mean return of 20 training episodes in a row first reaches the "
            "threshold. Fewer than 20 training episodes are too few to say so, or to say never.",
            "env steps", "lower", "times", True),
    Measure("threshold_episodes", "episodes to the threshold",
            "Training episodes until the same.",
            "episodes", "lower", "times"),
    Measure("learner_threshold_env_steps", "env steps to the learner's threshold",
            "Env steps until an evaluation of the learner alone first reaches the threshold in "
            "the mean. Fewer than 20 evaluation episodes in all are too few to say so, or never.",
            "env steps", "lower", "times"),
    Measure("learner_threshold_held", "threshold held",
            "Share of the evaluations after that one that reach the threshold, too.",
            "share", "higher", "times"),
    Measure("final_learner", "final learner alone",
            "Mean return of the learner alone (greedy, no planner, no veto) after training.",
            "return", "higher", "returns", True),
    Measure("final_vetoed", "final policy within the vetoes",
            "Mean return of the trained policy after training: the choice of the strategy, of the "
            "learner where there is none; the planner's action replaces a refused proposal.",
            "return", "higher", "returns"),
    Measure("planner", "planner alone",
            "Mean return of the planner alone, evaluated at the end of training.",
            "return", "higher", "returns"),
    Measure("rho", "ρ",
            "Probability after training that the learner leads an episode (`evidence`: that its "
            "lead is worth more, by the returns) or makes a proposal (`mixture`).",
            "share", None, "lead"),
    Measure("planner_led", "an episode that the planner leads",
            "What it is worth by the evidence of the training.",
            "return", "higher", "lead"),
    Measure("learner_led", "an episode that the learner leads",
            "What it is worth by the evidence of the training.",
            "return", "higher", "lead"),
    Measure("episodes", "episodes",
            "Complete training episodes.",
            "episodes", None, "cost"),
    Measure("terminated", "terminated episodes",
            "Training episodes that the environment ended (a fall, a goal; not a time limit).",
            "episodes", None, "safety"),
    Measure("unsafe", "unsafe executed",
            "Actions executed in training that the domain file flags unsafe.",
            "steps", "lower", "safety", True),
    Measure("avoidable_unsafe", "avoidable unsafe executed",
            "Those of them that were executed while another action was not flagged.",
            "steps", "lower", "safety"),
    Measure("unsafe_observed", "came out unsafe",
            "Steps of training that came out unsafe, by what was observed, foreseen or not.",
            "steps", "lower", "safety"),
    Measure("final_learner_unsafe", "unsafe, final learner alone",
            "Unsafe actions of the final evaluation of the learner alone, an episode.",
            "steps", "lower", "safety"),
    Measure("final_vetoed_unsafe", "unsafe, final policy within the vetoes",
            "Unsafe actions of the final evaluation within the vetoes, an episode.",
            "steps", "lower", "safety"),
    Measure("final_learner_unsafe_observed", "came out unsafe, final learner alone",
            "Steps of the final evaluation of the learner alone that came out unsafe, an episode.",
            "steps", "lower", "safety"),
    Measure("final_vetoed_unsafe_observed", "came out unsafe, final policy within the vetoes",
            "Steps of the final evaluation within the vetoes that came out unsafe, an episode.",
            "steps", "lower", "safety"),
    Measure("vetoes", "vetoes",
            "Proposals refused in training.",
            "steps", None, "safety"),
    Measure("planner_share", "planner's share",
            "Share of the env steps in which the planner's action was executed.",
            "share", None, "cost"),
    Measure("seconds", "seconds of training",
            "Wall time of training, evaluations left out.",
            "seconds", "lower", "cost"),
    Measure("seconds_per_1000", "seconds per 1,000 env steps",
            "The same per 1,000 env steps.",
            "seconds", "lower", "cost"),
)
"""All measures that every trial has, in the order in which they are reported."""
# fmt: on

BY_NAME: Final[Mapping[str, Measure]] = {measure.name: measure for measure in MEASURES}


def extra_measures(names: Iterable[str]) -> tuple[Measure, ...]:
    """Return the measures that only some tasks have: outcomes and counters of the environment."""
    found = []
    for name in sorted({name for name in names if name not in BY_NAME}):
        kind, _, what = name.partition(".")
        if kind == "outcome":
            title, unit = f"outcome {what}", "episodes"
            meaning = f"Training episodes that ended with the outcome “{what}”."
        else:
            title, unit = what, "count"
            meaning = f"Sum of the environment's “{what}” at the ends of the training episodes."
        found.append(Measure(name, title, meaning, unit, None, "safety"))
    return tuple(found)


Array = NDArray[np.float64]

NEVER: Final = float("inf")
"""The value of a time until something that did not happen."""


def measure(record: Record, env_steps: int, threshold: float | None) -> dict[str, float]:
    """Return every measure of a trial.

    Returns:
        Every name of `serp.runs.comparison.measures.MEASURES`, then `outcome.<name>` and
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


ENOUGH: Final = 5
"""Number of seeds below which intervals are rough; they tend to be too narrow."""


class Results:
    """Finished trials, in the order of the tables, and their measures.

    Methods that take a variant use the base by default.

    Attributes:
        metadata: As given.
        plan: That of the metadata.
        records: In the order of algorithms, variants (the base first) and seeds.
        measured: Trial → name of a measure → value; see `serp.runs.comparison.measures`.
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


EARLY: Final = "first_50"


class VariantRow(NamedTuple):
    """The results on one domain file.

    Attributes:
        variant: Its name.
        seeds: Finished trials with it.
        planner: Mean return of the planner alone.
        area: Area under the training curve, interquartile mean.
        early: Mean return of the first 50 episodes, interquartile mean.
        final: Final learner alone, interquartile mean.
        final_difference: By how much the mean of the final learner exceeds plain DQN's.
        early_difference: By how much the mean of the early returns exceeds that of the better of
            planner and plain DQN.
        better: Which of these two that is.
    """

    variant: str
    seeds: int
    planner: Estimate
    area: Estimate
    early: Estimate
    final: Estimate
    final_difference: Estimate
    early_difference: Estimate
    better: str


def subject(results: Results) -> str:
    """Return the algorithm whose results on variants are shown: `serp`, else the first."""
    names = [record.trial.algorithm for record in results.records]
    return SERP if SERP in names or not names else names[0]


def variant_rows(results: Results) -> tuple[VariantRow, ...]:
    """Return a row for each variant that has a finished trial, the base first."""
    ours = subject(results)
    return tuple(_row(results, ours, v) for v in results.plan.variants if results.of(ours, v))


def planner_returns(results: Results, variant: str) -> NDArray[np.float64]:
    """Return the mean return of the planner alone in each trial that evaluated it."""
    for algorithm in (PLANNER, subject(results)):
        found = results.known(algorithm, "planner", variant)
        if len(found):
            return found
    return results.known(PLANNER, "training_area", variant)


def _row(results: Results, ours: str, variant: str) -> VariantRow:
    planner = planner_returns(results, variant)
    planner_early = results.known(PLANNER, EARLY, variant)
    # Plain DQN needs no domain file: it ran on the base alone.
    early = {
        PLANNER: planner_early if len(planner_early) else planner,
        DQN: results.known(DQN, EARLY),
    }
    better = max(early, key=lambda name: early[name].mean() if len(early[name]) else -np.inf)
    own_early = results.known(ours, EARLY, variant)
    own_final = results.known(ours, "final_learner", variant)
    plain_final = results.known(DQN, "final_learner")
    return VariantRow(
        variant=variant,
        seeds=len(results.of(ours, variant)),
        planner=estimate(planner, mean),
        area=results.estimate(ours, "training_area", variant),
        early=results.estimate(ours, EARLY, variant),
        final=results.estimate(ours, "final_learner", variant),
        final_difference=difference(own_final, plain_final, mean),
        early_difference=difference(own_early, early[better], mean),
        better=better,
    )
