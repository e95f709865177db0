"""What is asked for: from the arguments of `compare` to a plan."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

from serp._util.numbers import real, seed_of
from serp.compare.algorithms import Changes
from serp.compare.analysis.results import PLAIN, PLANNER
from serp.compare.domain_files import domain_files
from serp.compare.plan import ComparisonPlan, keep_domain, kept_file, named, trials_of
from serp.compare.protocol import ComparisonProtocol
from serp.compare.records import Trial
from serp.errors import RunError, SettingsError, TaskError
from serp.settings import resolve
from serp.tasks.bound_task import BoundTask
from serp.tasks.registry import find_task, load_task
from serp.tasks.task import Task

_T = TypeVar("_T")

ALGORITHMS: Final = ("serp", "mrp", "dqn")
"""What is compared where nothing is said."""


def task_asked(
    task: Task | str | None, before: Mapping[str, Any] | None, folder: Path | None
) -> Task:
    """Return the task that is meant.

    Args:
        task: The task, its name or a domain file; None for that of the comparison so far.
        before: The plan so far; None where there is none.
        folder: The comparison's folder, where one is named.

    Raises:
        SerpError: There is no such task.
    """
    if isinstance(task, Task):
        return task
    if isinstance(task, str):
        return find_task(task)
    if task is not None:
        raise TaskError(f"a task is a serp.Task, a name or a domain file, not {task!r}")
    if before is None:
        raise RunError(
            "say what to compare on: name a task"
            + ("" if folder is None else f"; {folder} holds no comparison yet")
        )
    assert folder is not None
    # As it was kept: what is installed or in the working directory may be another file.
    kept = kept_file(folder, str(before["variants"][0]))
    return dataclasses.replace(load_task(str(before["task"])), domain=kept, problem=None)


def conditions_asked(
    before: Mapping[str, Any] | None, bound: BoundTask, **given: int | None
) -> ComparisonProtocol:
    """Return the equal terms: those of the comparison so far, else defaults.

    Raises:
        SettingsError: One is out of range, or differs from what the comparison had so far.
    """
    said = {name: value for name, value in given.items() if value is not None}
    if before is not None:
        conditions = dict(before["conditions"])
        for name, value in said.items():
            if conditions[name] != value:
                raise SettingsError(
                    f"this comparison has {name} = {conditions[name]}, not {value}: all of its "
                    "trials are on equal terms. Compare in another folder (--out)."
                )
        return ComparisonProtocol.from_dict(conditions)
    budget = said.pop("env_steps", None)
    if budget is None:
        budget = resolve("default", bound.task.settings).training.env_steps
    every = said.pop("evaluate_every", None)
    return ComparisonProtocol(
        env_steps=budget, evaluate_every=max(1, budget // 10) if every is None else every, **said
    )


def plan_asked(
    folder: Path,
    before: Mapping[str, Any] | None,
    bound: BoundTask,
    *,
    algorithms: Iterable[str] | None,
    seeds: int | Iterable[int] | None,
    model_variants: Iterable[str | Path],
    settings: Changes | None,
    changed: Mapping[str, Changes] | None,
    threshold: float | None,
    conditions: ComparisonProtocol,
) -> ComparisonPlan:
    """Return what was asked for before, and what is asked for now."""
    if before is not None and before["task"] != bound.name:
        raise RunError(f"{folder} compares on task {before['task']}, not on {bound.name}")
    old = before or {"algorithms": {}, "trials": [], "variants": [], "changes": {}}
    if before is not None and settings and _loaded(settings) != _loaded(old["changes"]):
        raise SettingsError(
            "settings of a comparison cannot change once it has begun. Compare in another folder "
            "(--out)."
        )
    known = {name: _loaded(entry["changes"]) for name, entry in old["algorithms"].items()}
    first = None if algorithms is None else _unique(algorithms)
    now = first or list(known or ALGORITHMS)
    own = Path(bound.domain.source.name)
    base = _base(bound, own) if before is None else str(old["variants"][0])
    if own == kept_file(folder, base):  # others lie beside the one that is installed
        own = Path(load_task(bound.name).load().source.name)
    files = domain_files(model_variants, bound.name, own)
    if files:  # what a file is worth is what its planner is worth; plain DQN is the line to beat
        now = _unique([*now, PLANNER, PLAIN])
    found = named(_unique([*known, *now]), {**known, **(changed or {})})
    if threshold is not None and real(threshold) is None:
        raise SettingsError(f"threshold must be a number, not {threshold!r}")
    variants = {base: keep_domain(folder, base, bound.domain, bound.task)}
    given = _by_name(files)
    for name, file in given.items():
        if name == base:
            raise SettingsError(f"{file}: a model variant needs another name than `{base}`")
        variants[name] = _variant(folder, name, file, bound)
    for name in old["variants"]:
        if name not in variants:
            variants[name] = _variant(folder, name, kept_file(folder, name), bound)
    trials = [Trial(str(a), str(v), int(s)) for a, v, s in old["trials"]]
    asked = {name: found[name] for name in now}
    places = [base, *given] if given or before is None else [*variants]
    chosen = _seeds(seeds, trials)
    if before is None or files or algorithms is not None or seeds is not None:
        trials += trials_of(asked, places, chosen)
    if threshold is None:
        threshold = old.get("threshold", _threshold_of(bound))
    return ComparisonPlan(
        folder=folder,
        name=bound.name,
        variants=variants,
        algorithms=found,
        trials=_unique(trials),
        conditions=conditions,
        changes=_loaded(old["changes"]) if before is not None else dict(settings or {}),
        threshold=threshold,
    )


def _loaded(changes: Mapping[str, Mapping[str, Any]]) -> Changes:
    """Return changes as they were before they went through JSON."""
    words = {"inf": float("inf"), "-inf": -float("inf")}
    return {
        section: {
            name: tuple(value)
            if isinstance(value, list)
            else words.get(value, value)
            if isinstance(value, str)
            else value
            for name, value in values.items()
        }
        for section, values in changes.items()
    }


def _unique(items: Iterable[_T]) -> list[_T]:
    return list(dict.fromkeys(items))


def _seeds(seeds: int | Iterable[int] | None, trials: Sequence[Trial]) -> list[int]:
    if seeds is None:
        return sorted({trial.seed for trial in trials}) or list(range(5))
    if isinstance(seeds, int) and not isinstance(seeds, bool):
        if seeds < 1:
            raise SettingsError(f"seeds must be a number >= 1 of them, or a list, not {seeds}")
        return list(range(seeds))
    if isinstance(seeds, Iterable):
        chosen = _unique([seed_of(seed) for seed in seeds])
        if not chosen:
            raise SettingsError("seeds: name at least one")
        return chosen
    raise SettingsError(f"seeds must be a number of them, or a list, not {seeds!r}")


def _base(bound: BoundTask, file: Path) -> str:
    """Return what the file that is compared on is called: like its task, or like a variant."""
    return file.stem if file.stem.startswith(f"{bound.name}-") else bound.name


def _threshold_of(bound: BoundTask) -> float | None:
    specification = bound.env.spec
    return None if specification is None else specification.reward_threshold


def _variant(folder: Path, name: str, file: Path, bound: BoundTask) -> Task:
    """Return the task with another domain file.

    Raises:
        DomainError: The file is missing or wrong.
        TaskError: It does not fit the task.
    """
    task = dataclasses.replace(bound.task, domain=file, problem=None)
    with task.bind() as variant:  # says what does not fit
        return keep_domain(folder, name, variant.domain, task)


def _by_name(files: Iterable[str | Path]) -> dict[str, Path]:
    """Return the domain files by what they are called in the comparison.

    Raises:
        SettingsError: Two have the same name.
    """
    found: dict[str, Path] = {}
    for file in map(Path, files):
        other = found.setdefault(file.stem, file)
        if other != file:
            raise SettingsError(f"two model variants are called `{file.stem}`: {other} and {file}")
    return found
