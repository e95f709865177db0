"""Which trials share a process: seeds of one algorithm learn side by side where that is faster."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterable, Sequence
from typing import Final

from serp.comparison.algorithms import Algorithm
from serp.comparison.records import Trial
from serp.learning.settings import DQNSettings

MOST: Final = 5
"""Trials that share a process: more are hardly faster, and an interruption loses all of them."""

_LARGE: Final = 10_000 * 64
"""Weights × samples of an update from which on its arithmetic costs more than its calls: networks
of several seeds then only drive each other out of the core's cache (`bench_side_by_side.py`)."""

_SHARED: Final = 0.13
"""Share of a trial's time that trials side by side spend once (as measured there)."""

Group = tuple[Trial, ...]


def faster_together(
    algorithm: Algorithm, learner: DQNSettings, input_size: int, action_count: int
) -> bool:
    """Whether seeds of an algorithm are faster side by side than one after another.

    Args:
        algorithm: Which.
        learner: The settings of its learner.
        input_size: Numbers in one input, roughly.
        action_count: Actions.
    """
    if algorithm.kind == "guest" or not learner.updates_per_step:
        return False
    sizes = (input_size, *learner.hidden, action_count)
    weights = learner.members * sum(a * b for a, b in itertools.pairwise(sizes))
    return weights * learner.batch_size <= _LARGE


def grouped(
    trials: Iterable[Trial], together: Callable[[Trial], bool], processes: int
) -> list[Group]:
    """Return the trials in groups, each for a process to run at a time, in the order to begin them.

    Trials of one algorithm on one domain file share a group, in the order of their seeds. The
    groups are as large as leaves all processes busy to the end: of each algorithm, whatever its
    trials cost, every process has about the same, and the largest groups begin first.

    Args:
        trials: What is to be run.
        together: Whether a trial may share a process.
        processes: How many run at a time.
    """
    alone: list[Group] = []
    alike: dict[tuple[str, str], list[Trial]] = {}
    for trial in trials:
        if together(trial):
            alike.setdefault((trial.algorithm, trial.variant), []).append(trial)
        else:
            alone.append((trial,))
    best: list[Group] = []
    least = float("inf")
    for most in range(MOST, 0, -1):
        groups = [group for seeds in alike.values() for group in _split(seeds, most, processes)]
        groups += alone
        groups.sort(key=lambda group: -len(group))
        time = time_of(groups, processes)
        if time < least:
            best, least = groups, time
    return best


def _split(trials: Sequence[Trial], most: int, processes: int) -> list[Group]:
    """Return groups of at most so many, about equal, as many as processes where pairs allow it."""
    count = len(trials) if most == 1 else -(-len(trials) // most)
    count = max(count, min(len(trials) // 2, processes))
    bounds = [len(trials) * i // count for i in range(count + 1)]
    return [tuple(trials[a:b]) for a, b in itertools.pairwise(bounds)]


def time_of(groups: Iterable[Group], processes: int) -> float:
    """Return how long groups take in so many processes, in units of a trial alone."""
    ends = [0.0] * processes
    for group in groups:
        heapq.heapreplace(ends, ends[0] + len(group) * (1.0 - _SHARED) + _SHARED)
    return max(ends)
