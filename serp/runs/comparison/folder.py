"""The folder of a comparison: its lock, and its copies of the domain files.

comparison/plan.json                     the plan
comparison/domains/VARIANT.pddl          copies of the domain files at the beginning
comparison/trials/…                      complete trials, see `serp.runs.comparison.trial_files`
comparison/report.md, …                  the report, see `serp.runs.comparison.report`
"""

from __future__ import annotations

import contextlib
import dataclasses
import shutil
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np

from serp._util.files import cannot_write, make_inside, write_durably
from serp.errors import RunError
from serp.model.domain import Domain, load_domain
from serp.model.reachability import MAX_GROUND_SCHEMAS
from serp.runs.comparison.plan import (
    Columns,
    ComparisonPlan,
    Record,
    Trial,
    has_plan,
    read_plan,
    write_plan,
)
from serp.runs.comparison.trial_files import (
    copy_trial,
    file_name,
    is_complete,
    read_metadata,
    read_trial,
)
from serp.runs.folder import CONFIG, LOCK, RunLock
from serp.tasks.task import Task

_DOMAINS: Final = "domains"


@contextlib.contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Create a folder and lock it; remove it again if the body writes no plan.

    Raises:
        RunError: It cannot be created, holds other files, or another process writes it.
    """
    if (
        folder.is_dir()
        and not has_plan(folder)
        and {file.name for file in folder.iterdir()} - {LOCK}
    ):
        what = "a run" if (folder / CONFIG).exists() else "other files"
        raise RunError(
            f"{folder} holds {what}, not a comparison. Give a new or empty folder with --out. "
            "Nothing was changed."
        )
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error, "Nothing was made.") from error
    lock = RunLock(folder)
    try:
        yield
    finally:
        begun = has_plan(folder)
        if not begun:  # the folder was empty before
            shutil.rmtree(folder / _DOMAINS, ignore_errors=True)
        lock.release()
        if folder in missing and not begun:
            shutil.rmtree(folder, ignore_errors=True)
            with contextlib.suppress(OSError):  # another process may have written there
                for place in missing[1:]:
                    place.rmdir()


def kept_file(folder: Path, variant: str) -> Path:
    """Return where a comparison keeps the domain file of a variant."""
    return folder / _DOMAINS / f"{file_name(variant)}.pddl"


def kept_files(folder: Path, variant: str) -> tuple[Path, Path]:
    """Return where a comparison keeps the domain file of a variant, and its problem file if any."""
    domain = kept_file(folder, variant)
    return domain, domain.with_name(f"{domain.stem}-problem.pddl")


def keep_domain(folder: Path, variant: str, domain: Domain, task: Task) -> Task:
    """Return a task with the comparison's copy of its domain file.

    The file is copied into the folder at the beginning, so that later edits have no effect.
    """
    place, beside = kept_files(folder, variant)
    texts = {place: domain.source.text}
    if domain.problem_source is not None:
        texts[beside] = domain.problem_source.text
    elif place.is_file() and beside.is_file():
        raise RunError(
            f"{beside} is a problem file, and the domain file `{variant}` has none now. Compare in "
            "another folder (--out)."
        )
    make_inside(folder, _DOMAINS)
    for file, text in texts.items():
        if file.is_file() and file.read_bytes() != text.encode():
            raise RunError(
                f"{file} differs from the domain file `{variant}`, which was edited since this "
                "comparison began. Compare in another folder (--out)."
            )
        write_durably(file, text)
    return with_domain(task, place, domain.max_ground_schemas)


def texts_of(task: Task) -> list[str]:
    """Return the texts of all files of a loaded task: domain, problem, and its planners' ones."""
    domains = [d for d in (task.domain, *task.planners.values()) if isinstance(d, Domain)]
    return [source.text for domain in domains for source in domain.sources]


def with_domain(task: Task, file: Path, limit: int = MAX_GROUND_SCHEMAS) -> Task:
    """Return a task with another domain file, and the problem file beside it if there is one.

    With another limit on its size than the default, the file is loaded at once.
    """
    if limit == MAX_GROUND_SCHEMAS:
        return dataclasses.replace(task, domain=file, problem=None)
    domain = load_domain(file, observed=not task.closed, max_ground_schemas=limit)
    return dataclasses.replace(task, domain=domain, problem=None)


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
