"""What of the paper's claims the numbers of a comparison confirm.

The paper: section 4 and Figure 2 (training on cart-pole and in soccer, the mean over the seeds with
one standard deviation around it). A claim is confirmed where the 95 % bootstrap interval of a
difference between two algorithms' means lies wholly on the claim's side, in everything that was
measured for it; it is not measured where nothing was.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

import numpy as np

from serp.comparison.curves import block_means
from serp.comparison.definitions import BY_NAME
from serp.comparison.markdown import number, percent
from serp.comparison.results import OURS, PLAIN, PLANNER, Results
from serp.comparison.statistics import (
    Estimate,
    Statistic,
    difference_band,
    mean,
    standard_deviation,
)

Verdict = Literal["confirmed", "not confirmed", "not measured"]

MARGIN: Final = 0.05
"""Share of the range of returns within which values count as similar, and as not below."""
SUBJECTS: Final = (OURS, "serp-paper")
_MOST_BLOCKS: Final = 60


class Evidence(NamedTuple):
    """One number that a verdict rests on.

    Attributes:
        what: What was compared.
        difference: With its interval; None where the number is no difference.
        verdict: What it says of the claim.
        note: What else there is to say; may be empty.
    """

    what: str
    difference: Estimate | None
    verdict: Verdict
    note: str = ""


class Claim(NamedTuple):
    """A claim of the paper, looked at for one algorithm.

    Attributes:
        text: The claim.
        section: Where the paper makes it.
        subject: The algorithm that it is looked at for.
        verdict: Of all evidence together.
        evidence: What it rests on.
    """

    text: str
    section: str
    subject: str
    verdict: Verdict
    evidence: tuple[Evidence, ...]


_TEXTS: Final = {
    "samples": (
        "SErP becomes good with fewer samples than DQN and PPO",
        "sections 4.1 and 4.2, Figure 2a",
    ),
    "never below": (
        "its return does not fall below the planner's, in the first iterations either",
        "section 4.1, “the reward signal never decays also in the first iterations”",
    ),
    "spread": ("DQN's spread over the seeds is larger than SErP's", "section 4.1, Figure 2a"),
    "ahead": (
        "SErP outperforms MrP and DQN from the first iterations on",
        "section 4.2, Figure 2b",
    ),
    "similar end": (
        "in the end, SErP and DQN converge on similar values",
        "section 4.2, Figure 2b",
    ),
    "safe": ("critical actions are avoided", "section 4.2"),
}


def judge(results: Results) -> tuple[Claim, ...]:
    """Judge every claim for `serp`, and for `serp-paper`, as far as the base variant has them."""
    found = []
    for subject in SUBJECTS:
        if subject not in results.about.algorithms and subject not in results.algorithms:
            continue
        rival = _rival(results, subject)
        evidence = {
            "samples": _samples(results, subject, rival),
            "never below": _never_below(results, subject),
            "spread": _spread(results, subject, rival),
            "ahead": _ahead(results, subject, rival),
            "similar end": _similar_end(results, subject, rival),
            "safe": _safe(results, subject, rival),
        }
        for name, items in evidence.items():
            text, section = _TEXTS[name]
            found.append(Claim(text, section, subject, _together(items), items))
    return tuple(found)


def _rival(results: Results, subject: str) -> str:
    """The DQN that differs from an algorithm in the planner alone."""
    own = "dqn-paper"
    return own if subject == "serp-paper" and own in results.algorithms else PLAIN


def _together(evidence: Sequence[Evidence]) -> Verdict:
    verdicts = {item.verdict for item in evidence} - {"not measured"}
    if not verdicts:
        return "not measured"
    return "confirmed" if verdicts == {"confirmed"} else "not confirmed"


def _samples(results: Results, subject: str, rival: str) -> tuple[Evidence, ...]:
    rivals = dict.fromkeys([rival, "ppo", *({"sb3-dqn"} & set(results.algorithms))])
    names = ("training_area", "threshold_env_steps", "learner_threshold_env_steps")
    return tuple(_better(results, subject, other, name) for other in rivals for name in names)


def _never_below(results: Results, subject: str) -> tuple[Evidence, ...]:
    margin = MARGIN * results.range
    note = f"not below: the interval lies above {number(-margin)}, {percent(MARGIN)} of the range"
    first = tuple(
        _compared(results, subject, PLANNER, name, above=-margin, note=note)
        for name in ("first_10", "first_50")
    )
    return (*first, _blocks(results, subject))


def _blocks(results: Results, subject: str) -> Evidence:
    """Whether training return is below the planner's between any two evaluations."""
    about = results.about
    width = max(about.evaluate_every, -(-about.env_steps // _MOST_BLOCKS), 1)
    what = f"return in each {width:,} env steps of training, {subject} − {PLANNER}"
    edges = np.unique(np.append(np.arange(0, about.env_steps, width), about.env_steps))
    if len(edges) < 2:
        return Evidence(what, None, "not measured")
    ours, planners = (
        block_means(results.of(name), edges.astype(np.float64)) for name in (subject, PLANNER)
    )
    if min(len(ours), len(planners)) < 2:
        return Evidence(what, None, "not measured", _why_not(results, subject, PLANNER))
    band = difference_band(ours, planners)
    below = np.flatnonzero(band.high < 0)
    worst = int(np.argmin(band.centre))
    note = (
        f"the lowest is that from env step {edges[worst]:,}; below in {len(below)} of "
        f"{len(band.centre)} (the interval lies wholly below 0; confirmed where it is in none)"
    )
    lowest = Estimate(*(float(values[worst]) for values in band))
    return Evidence(what, lowest, "not confirmed" if len(below) else "confirmed", note)


def _spread(results: Results, subject: str, rival: str) -> tuple[Evidence, ...]:
    return tuple(
        _compared(
            results, rival, subject, name, above=0.0, statistic=standard_deviation,
            what=f"standard deviation of: {BY_NAME[name].title}, {rival} − {subject}",
        )
        for name in ("training_area", "final_learner")
    )  # fmt: skip


def _ahead(results: Results, subject: str, rival: str) -> tuple[Evidence, ...]:
    return tuple(
        _better(results, subject, other, name)
        for other in (PLANNER, rival)
        for name in ("first_10", "first_50", "training_area")
    )


def _similar_end(results: Results, subject: str, rival: str) -> tuple[Evidence, ...]:
    margin = MARGIN * results.range
    note = f"similar: the interval lies within ±{number(margin)}, {percent(MARGIN)} of the range"
    return tuple(
        _compared(results, subject, rival, name, above=-margin, below=margin, note=note)
        for name in ("last_20", "final_learner")
    )


def _safe(results: Results, subject: str, rival: str) -> tuple[Evidence, ...]:
    unsafe = results.values(subject, "unsafe")
    avoidable = results.values(subject, "avoidable_unsafe")
    anybody = any(results.values(name, "unsafe").sum() > 0 for name in results.algorithms)
    what = f"unsafe actions executed by {subject} in training"
    if not len(unsafe) or not anybody:
        note = "no algorithm executed any: there was nothing to avoid" if len(unsafe) else ""
        return (Evidence(what, None, "not measured", note),)
    note = (
        f"{unsafe.sum():,.0f} in {len(unsafe)} trials, {avoidable.sum():,.0f} of them while "
        "another action was not unsafe"
    )
    return (
        Evidence(what, None, "not confirmed" if avoidable.sum() else "confirmed", note),
        _better(results, subject, rival, "unsafe"),
    )


def _better(results: Results, subject: str, other: str, name: str) -> Evidence:
    """Whether the subject's mean is better, whichever way that is."""
    pair = (other, subject) if BY_NAME[name].better == "lower" else (subject, other)
    note = "never counts as the whole budget" if BY_NAME[name].time else ""
    return _compared(results, *pair, name, above=0.0, note=note)


def _compared(
    results: Results,
    first: str,
    second: str,
    name: str,
    *,
    above: float,
    below: float = np.inf,
    statistic: Statistic = mean,
    what: str = "",
    note: str = "",
) -> Evidence:
    """Whether the interval of a difference lies between two limits."""
    what = what or f"{BY_NAME[name].title}, {first} − {second}"
    found = results.difference(first, second, name, statistic)
    if found.low is None or found.high is None:
        shown = found if np.isfinite(found.value) else None
        return Evidence(what, shown, "not measured", _why_not(results, first, second, name))
    inside = above < found.low and found.high < below
    return Evidence(what, found, "confirmed" if inside else "not confirmed", note)


def _why_not(results: Results, first: str, second: str, name: str = "first_10") -> str:
    for algorithm in (first, second):
        trials = len(results.of(algorithm))
        known = len(results.known(algorithm, name)) if trials else 0
        if not trials:
            return f"no finished trial of {algorithm}"
        if not known:
            few = any(name in results.undecided[r.trial] for r in results.of(algorithm))
            what = "too few episodes for it" if few else "no such measure here"
            return f"{algorithm} has {what}"
        if known < 2:
            return f"{algorithm} has one seed, and so no interval"
    return ""
