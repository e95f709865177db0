"""Merging comparisons of the same kind that several writers made."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np

from serp._util.files import make_inside, write_durably
from serp.comparison.folder import kept_files
from serp.comparison.plan import ComparisonPlan, read_plan, write_plan
from serp.comparison.trial_files import copy_trial, is_complete, read_metadata, read_trial
from serp.comparison.trial_records import Columns, Record, Trial
from serp.errors import RunError

_ALIKE: Final = {
    "task": "task",
    "base": "domain file",
    "protocol": "budget or evaluations",
    "changes": "settings",
    "max_ground_schemas": "limit on ground schemas",
}
"""What comparisons have in common that can be merged."""
_REFUSED: Final = "Nothing was merged."


def merge_into(folder: Path, others: Sequence[Path]) -> None:
    """Copy what other comparisons have into a folder that is locked; it may be empty.

    Raises:
        RunError: One of them is no comparison, or contradicts another: other settings, another
            domain file of the same name, or the same trial with other numbers.
    """
    own = read_plan(folder)
    plans = {folder: own} if own is not None else {}
    for other in others:
        plan = read_plan(other)
        if plan is None:
            raise RunError(f"{other} holds no comparison. {_REFUSED}")
        plans[other] = plan
    merged = _merged(plans)
    files = _domain_files(plans)
    copied = _trials_to_copy(folder, plans)
    make_inside(folder, "domains")
    for file, content in files.items():
        write_durably(folder / file, content)
    write_plan(folder, merged)
    for trial, source in copied.items():
        copy_trial(source, folder, trial)


def _merged(plans: dict[Path, ComparisonPlan]) -> ComparisonPlan:
    """Return one plan for all of them."""
    (first, plan), *rest = plans.items()
    algorithms = dict(plan.algorithms)
    for other, found in rest:
        for name, what in _ALIKE.items():
            if getattr(found, name) != getattr(plan, name):
                raise RunError(f"{other} has another {what} than {first}. {_REFUSED}")
        for name, changes in found.algorithms.items():
            if algorithms.setdefault(name, changes) != changes:
                raise RunError(f"{other} has other settings of `{name}` than {first}. {_REFUSED}")
    variants = chain.from_iterable(each.variants for each in plans.values())
    trials = chain.from_iterable(each.trials for each in plans.values())
    update = {
        "algorithms": algorithms,
        "variants": tuple(dict.fromkeys(variants)),
        "trials": tuple(dict.fromkeys(trials)),
    }
    return plan.model_copy(update=update)


def _domain_files(plans: dict[Path, ComparisonPlan]) -> dict[str, bytes]:
    """Return the copies of all domain and problem files, by their places in the folder."""
    files: dict[str, bytes | None] = {}
    for folder, plan in plans.items():
        for variant in plan.variants:
            for file in kept_files(folder, variant):
                place = file.relative_to(folder).as_posix()
                content = file.read_bytes() if file.is_file() else None
                if files.setdefault(place, content) != content:
                    raise RunError(f"{file} differs from that of the others. {_REFUSED}")
    return {place: content for place, content in files.items() if content is not None}


def _trials_to_copy(folder: Path, plans: dict[Path, ComparisonPlan]) -> dict[Trial, Path]:
    """Return which trial is copied from which comparison; refuse contradictions."""
    sources: dict[Trial, Path] = {}
    made_of: dict[tuple[str, str], Any] = {}
    for place, plan in plans.items():
        for trial in plan.trials:
            if not is_complete(place, trial):
                continue
            now = read_metadata(place, trial).get("made_of")
            if made_of.setdefault(trial[:2], now) != now:
                raise RunError(
                    f"{place}: the trial of {trial} was made with other settings or files than "
                    f"those of the others. {_REFUSED}"
                )
            before = sources.setdefault(trial, place)
            if place == folder:
                continue
            record = read_trial(place, trial)
            if before != place and not _equal(read_trial(before, trial), record):
                raise RunError(
                    f"{before} and {place} have different numbers for {trial}. Remove the trial "
                    f"from one of them. {_REFUSED}"
                )
    return {trial: place for trial, place in sources.items() if place != folder}


def _equal(first: Record, second: Record) -> bool:
    """Return whether two records are equal, but for the time that the trials took."""

    def same(one: Columns, other: Columns) -> bool:
        return one.keys() == other.keys() and all(
            np.array_equal(one[name], other[name], equal_nan=one[name].dtype.kind == "f")
            for name in one
            if name != "seconds"
        )

    return same(first.episodes, second.episodes) and same(first.evaluations, second.evaluations)
