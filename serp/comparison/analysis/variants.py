"""Results of one algorithm on several domain files (*variants*) for the same task."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp.comparison.algorithms import DQN, PLANNER, SERP
from serp.comparison.analysis.results import Results
from serp.comparison.analysis.statistics import Estimate, difference, estimate, mean

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
