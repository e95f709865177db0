"""Results of one algorithm on several domain files for the same task.

For every domain file (a *variant*): the return of the planner that uses it, the results of learning
with it, and whether these are worse than those of learning without a planner.
"""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp.comparison.algorithms import DQN, PLANNER, SERP
from serp.comparison.analysis.results import Results
from serp.comparison.analysis.statistics import Estimate, difference, estimate, mean

Verdict = Literal["holds", "does not hold", "undecided", "not measured"]

FINAL_MARGIN: Final = 0.05
"""By how much of the range the final learner may be worse than plain DQN's."""
EARLY_MARGIN: Final = 0.10
"""By how much of the range early returns may be below the better of planner and plain DQN."""
EARLY: Final = "first_50"


class Check(NamedTuple):
    """A difference that must not be too far below 0.

    Attributes:
        to: The algorithm compared with.
        difference: Difference of the means, with its 95 % interval; NaN if it was not measured.
        limit: Smallest acceptable difference.
        verdict: `holds` if the whole interval is above the limit, `does not hold` if it is below,
            `undecided` if the limit is inside.
    """

    to: str
    difference: Estimate
    limit: float
    verdict: Verdict


class VariantRow(NamedTuple):
    """The results on one domain file.

    Attributes:
        variant: Its name.
        seeds: Finished trials with it.
        planner: Mean return of the planner alone.
        area: Area under the training curve, interquartile mean.
        early: Mean return of the first 50 episodes, interquartile mean.
        final: Final learner alone, interquartile mean.
        final_check: The final learner against plain DQN's.
        early_check: Early returns against the better of planner and plain DQN.
    """

    variant: str
    seeds: int
    planner: Estimate
    area: Estimate
    early: Estimate
    final: Estimate
    final_check: Check
    early_check: Check


def subject(results: Results) -> str:
    """Return the algorithm whose results on variants are shown: `serp`, else the first."""
    names = {record.trial.algorithm: None for record in results.records}
    return SERP if SERP in names else next(iter(names), SERP)


def variant_rows(results: Results) -> tuple[VariantRow, ...]:
    """Return a row for each variant that has a finished trial, the base first."""
    ours = subject(results)
    return tuple(
        _row(results, ours, variant) for variant in results.variants if results.of(ours, variant)
    )


def pooled_final(results: Results) -> Check:
    """Compare the final learner over all variants together with that of plain DQN.

    The variants are the strata: the seeds of each are resampled alone. Plain DQN uses no domain
    file, so that its trials are one stratum.
    """
    ours = subject(results)
    found = [name for name in results.variants if results.of(ours, name)]
    strata = [results.known(ours, "final_learner", name) for name in found]
    plain = results.known(DQN, "final_learner")
    return _check(DQN, difference(strata, [plain], mean), FINAL_MARGIN * results.range)


def planner_returns(results: Results, variant: str) -> NDArray[np.float64]:
    """Return the mean return of the planner alone in each trial that evaluated it."""
    for algorithm in (PLANNER, subject(results)):
        found = results.known(algorithm, "planner", variant)
        if len(found):
            return found
    return results.known(PLANNER, "training_area", variant)


def _row(results: Results, ours: str, variant: str) -> VariantRow:
    final = results.known(ours, "final_learner", variant)
    early = results.known(ours, EARLY, variant)
    plain_early = _plain(results, EARLY, variant)
    planner_early = results.known(PLANNER, EARLY, variant)
    if not len(planner_early):
        planner_early = planner_returns(results, variant)
    references = {PLANNER: planner_early, DQN: plain_early}
    better = max(
        references, key=lambda name: references[name].mean() if len(references[name]) else -np.inf
    )
    final_difference = difference([final], [_plain(results, "final_learner", variant)], mean)
    return VariantRow(
        variant=variant,
        seeds=len(results.of(ours, variant)),
        planner=estimate([planner_returns(results, variant)], mean),
        area=results.estimate(ours, "training_area", variant),
        early=results.estimate(ours, EARLY, variant),
        final=results.estimate(ours, "final_learner", variant),
        final_check=_check(DQN, final_difference, FINAL_MARGIN * results.range),
        early_check=_check(
            better, difference([early], [references[better]], mean), EARLY_MARGIN * results.range
        ),
    )


def _plain(results: Results, name: str, variant: str) -> NDArray[np.float64]:
    """Return a measure of plain DQN, which needs no domain file: on the variant, else the base."""
    own = results.known(DQN, name, variant)
    return own if len(own) else results.known(DQN, name)


def _check(to: str, found: Estimate, margin: float) -> Check:
    verdict: Verdict = "undecided"
    if found.low is None or found.high is None:
        verdict = "not measured"
    elif found.low > -margin:
        verdict = "holds"
    elif found.high < -margin:
        verdict = "does not hold"
    return Check(to, found, -margin, verdict)
