"""The options of `compare`, and how they become a plan together with an existing one."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypedDict, TypeVar

from serp._util.numbers import real, seed_of, whole
from serp._util.text import did_you_mean
from serp.comparison.algorithms import DQN, PLANNER, Changes
from serp.comparison.folder import SavedPlan, keep_domain, kept_file, loaded_changes, with_domain
from serp.comparison.plan import ComparisonPlan, named_algorithms, trials_of
from serp.comparison.protocol import ComparisonProtocol
from serp.comparison.trial_records import Trial
from serp.errors import RunError, SettingsError, TaskError
from serp.settings import resolve
from serp.tasks.bound_task import BoundTask
from serp.tasks.registry import find_task, load_task
from serp.tasks.task import Task

_T = TypeVar("_T")

ALGORITHMS: Final = ("serp", PLANNER, DQN)
"""Algorithms compared by default."""
SEEDS: Final = 5


class ComparisonRequest(TypedDict, total=False):
    """The options of `serp.compare`, all of them optional; None stands for the default.

    When a comparison is continued, the defaults are its own values.

    Attributes:
        algorithms: Names, such as `serp`, `mrp`, `dqn` or `ppo`; the others are compared with the
            first. `name:text` is an algorithm with other settings, see `changed`. By default
            `serp`, `mrp` and `dqn`.
        seeds: Number of seeds, from 0 on, or a list of seeds; 5 by default.
        env_steps: Budget of each trial; by default `training.env_steps` of the task.
        model_variants: Further domain files for the task; every algorithm that uses a model also
            runs on each of them. Files, names of files beside the task's own domain file
            (`cartpole-reversed`), patterns of either, or `all`: every file there whose name begins
            with that of the task and a hyphen.
        settings: Section → setting → value; applies to all of serp's algorithms.
        changed: Name such as `serp:learner.members=1` → changes for that algorithm only.
        threshold: Return from which a policy counts as good; by default the `reward_threshold` of
            the environment's Gymnasium specification, if it has one.
        evaluate_every: Env steps between evaluations of the learner; a tenth of the budget by
            default.
        evaluation_episodes: Episodes of each such evaluation; 10 by default.
        final_episodes: Episodes of each evaluation at the end; 50 by default.
        out: Folder of the comparison; by default `runs/compare-<domain>-<time>`.
        jobs: Number of processes; by default the number of cores.
        quiet: Show no progress.
    """

    algorithms: Iterable[str] | None
    seeds: int | Iterable[int] | None
    env_steps: int | None
    model_variants: Iterable[str | Path]
    settings: Changes | None
    changed: Mapping[str, Changes] | None
    threshold: float | None
    evaluate_every: int | None
    evaluation_episodes: int | None
    final_episodes: int | None
    out: str | Path | None
    jobs: int | None
    quiet: bool


def requested_folder(out: Any) -> Path | None:
    """Return the requested folder; None for the default.

    Raises:
        SettingsError: It is not the name of a folder.
    """
    if not isinstance(out, str | os.PathLike | None) or "\0" in str(out):
        raise SettingsError(f"out must be the name of a folder, not {out!r}")
    return None if out is None else Path(out)


def requested_processes(jobs: int | None) -> int:
    """Return the number of processes.

    Raises:
        SettingsError: It is not a whole number, or less than 1.
    """
    count = whole(os.cpu_count() or 1 if jobs is None else jobs, 1)
    if count is None:
        raise SettingsError(f"jobs must be a whole number >= 1, not {jobs!r}")
    return count


def requested_task(task: Task | str | None, before: SavedPlan | None, folder: Path | None) -> Task:
    """Return the requested task.

    Args:
        task: The task, its name or a domain file; None for that of the existing comparison.
        before: The existing plan, if there is one.
        folder: The comparison's folder, if one is given.

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
    # The copy, because the original file may have changed.
    kept = kept_file(folder, before.variants[0])
    return with_domain(load_task(before.task), kept, limit=before.max_ground_schemas)


def requested_plan(
    folder: Path, before: SavedPlan | None, bound: BoundTask, request: ComparisonRequest
) -> ComparisonPlan:
    """Return the existing plan extended by a request.

    The domain files are copied into the folder.

    Args:
        folder: The folder of the comparison, locked.
        before: The existing plan, if there is one.
        bound: The task with the base domain file.
        request: The request.

    Raises:
        SerpError: The request is wrong, or contradicts the existing plan.
    """
    if before is not None and before.task != bound.name:
        raise RunError(f"{folder} compares on task {before.task}, not on {bound.name}")
    changes, threshold = request.get("settings") or {}, request.get("threshold")
    if before is not None and changes and loaded_changes(changes) != before.changes:
        raise SettingsError(
            "settings of a comparison cannot change once it has begun. Compare in another folder "
            "(--out)."
        )
    if threshold is not None and real(threshold) is None:
        raise SettingsError(f"threshold must be a number, not {threshold!r}")
    protocol = _protocol(before, bound, request)
    base = _base_name(bound) if before is None else before.variants[0]
    files = domain_files(request.get("model_variants") or (), bound.name, _installed(bound, folder))
    algorithms, now = _algorithms(before, request, with_references=bool(files))
    variants = _variants(folder, before, bound, base, files)
    trials = [] if before is None else list(before.trials)
    if before is None or files or not {"algorithms", "seeds"}.isdisjoint(_given(request)):
        named = [base, *(file.stem for file in files)]
        asked = named if files or before is None else list(variants)
        trials += trials_of(
            {name: algorithms[name] for name in now}, asked, _seeds(request.get("seeds"), trials)
        )
    if threshold is None:
        threshold = default_threshold(bound) if before is None else before.threshold
    return ComparisonPlan(
        folder=folder,
        task=bound.name,
        variants=variants,
        algorithms=algorithms,
        trials=_unique(trials),
        protocol=protocol,
        changes=changes if before is None else before.changes,
        threshold=threshold,
        max_ground_schemas=bound.domain.max_ground_schemas,
    )


def _given(request: ComparisonRequest) -> dict[str, Any]:
    return {name: value for name, value in request.items() if value is not None}


def _protocol(
    before: SavedPlan | None, bound: BoundTask, request: ComparisonRequest
) -> ComparisonProtocol:
    """Return the protocol of the existing plan, else that of the request with defaults.

    Raises:
        SettingsError: A value is out of range, or differs from that of the existing plan.
    """
    names = ("env_steps", "evaluate_every", "evaluation_episodes", "final_episodes")
    given = {name: value for name, value in _given(request).items() if name in names}
    if before is not None:
        for name, value in given.items():
            if getattr(before.protocol, name) != value:
                raise SettingsError(
                    f"this comparison has {name} = {getattr(before.protocol, name)}, not {value}: "
                    "all of its trials have the same protocol. Compare in another folder (--out)."
                )
        return before.protocol
    if "env_steps" not in given:
        given["env_steps"] = resolve("default", bound.task.settings).training.env_steps
    steps = whole(given["env_steps"], 1) or 1  # the protocol refuses any other
    return ComparisonProtocol(**{"evaluate_every": max(1, steps // 10), **given})


def _algorithms(
    before: SavedPlan | None, request: ComparisonRequest, *, with_references: bool
) -> tuple[dict[str, Any], list[str]]:
    """Return all algorithms by name, and the names of the requested ones.

    Args:
        before: The existing plan, if there is one.
        request: The request.
        with_references: Whether to add the references for results on domain files: planner and
            baseline.
    """
    known = {} if before is None else before.algorithms
    now = _unique(request.get("algorithms") or ()) or list(known or ALGORITHMS)
    if with_references:
        now = _unique([*now, PLANNER, DQN])
    changed = {**known, **(request.get("changed") or {})}
    return named_algorithms(_unique([*known, *now]), changed), now


def _variants(
    folder: Path, before: SavedPlan | None, bound: BoundTask, base: str, files: Sequence[Path]
) -> dict[str, Task]:
    """Return the task with the comparison's copy of each domain file, the base first."""
    places = {name: kept_file(folder, name) for name in (before.variants if before else ())}
    places.pop(base, None)
    given: dict[str, Path] = {}
    for file in files:
        other = given.setdefault(file.stem, file)
        if other != file:
            raise SettingsError(f"two model variants are called `{file.stem}`: {other} and {file}")
    variants = {base: keep_domain(folder, base, bound.domain, bound.task)}
    for name, file in {**given, **{n: p for n, p in places.items() if n not in given}}.items():
        if name == base:
            raise SettingsError(f"{file}: a model variant needs another name than `{base}`")
        task = with_domain(bound.task, file, limit=bound.domain.max_ground_schemas)
        with task.bind() as variant:  # checks that the file fits the task
            variants[name] = keep_domain(folder, name, variant.domain, task)
    return variants


def domain_files(asked: Iterable[str | Path], task: str, own: Path) -> list[Path]:
    """Return the domain files that `model_variants` names, in order, each once.

    Args:
        asked: See `ComparisonRequest`.
        task: Name of the task.
        own: The task's own domain file.

    Raises:
        TaskError: A name or pattern matches no file.
    """
    found: dict[Path, None] = {}
    for name in map(str, asked):
        with_suffix = name if name.endswith(".pddl") else f"{name}.pddl"
        if name == "all":
            matches = sorted(own.parent.glob(f"{glob.escape(task)}-*.pddl"))
        elif glob.has_magic(name):
            matches = sorted(map(Path, glob.glob(name))) or sorted(own.parent.glob(with_suffix))
        else:
            places = (Path(name), own.parent / with_suffix)
            matches = [path for path in places if path.is_file()][:1]
        matches = [path for path in matches if not path.name.endswith("-problem.pddl")]
        if not matches:
            known = sorted(path.stem for path in own.parent.glob("*.pddl") if path != own)
            raise TaskError(f"there is no domain file {name}; {did_you_mean(name, known)}")
        found.update(dict.fromkeys(matches))
    return list(found)


def _installed(bound: BoundTask, folder: Path) -> Path:
    """Return the task's own domain file, beside which its variants lie."""
    own = Path(bound.domain.source.name)
    if own.parent == kept_file(folder, "any").parent:
        own = Path(load_task(bound.name).load().source.name)
    return own


def _base_name(bound: BoundTask) -> str:
    """Return the name of the base variant: that of the task, or of a variant's file."""
    name = Path(bound.domain.source.name).stem
    return name if name.startswith(f"{bound.name}-") else bound.name


def default_threshold(bound: BoundTask) -> float | None:
    """Return the `reward_threshold` of the environment's specification, if it has one."""
    specification = bound.env.spec
    return None if specification is None else specification.reward_threshold


def _seeds(seeds: int | Iterable[int] | None, trials: Sequence[Trial]) -> list[int]:
    if seeds is None:
        return sorted({trial.seed for trial in trials}) or list(range(SEEDS))
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


def _unique(items: Iterable[_T]) -> list[_T]:
    return list(dict.fromkeys(items))
