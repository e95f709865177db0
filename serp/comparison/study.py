"""Comparing: `compare` plans the trials, runs those that are missing, and writes the report."""

from __future__ import annotations

import dataclasses
import os
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from serp.comparison.about import ComparisonAbout
from serp.comparison.algorithms import Algorithm, Changes
from serp.comparison.conditions import Conditions
from serp.comparison.contender import make_contender
from serp.comparison.domain_files import domain_files
from serp.comparison.fairness import judges_alike
from serp.comparison.folder import writing
from serp.comparison.plan import Plan, keep_domain, kept_file, named, read_plan, trials_of
from serp.comparison.progress import Display, Outlook
from serp.comparison.records import Trial
from serp.comparison.report import overview, write_report
from serp.comparison.results import PLANNER, Results
from serp.comparison.storage import is_complete, read_trial
from serp.comparison.terms import settings_in_use
from serp.comparison.trial import unit_of
from serp.comparison.workers import Job, portable, run_here, run_in_processes
from serp.errors import Interrupted, RunError, SettingsError, TaskError
from serp.quantities import real, seed_of, whole
from serp.registry import find_task, load_task
from serp.runs.placement import default_path
from serp.settings import resolve
from serp.stopping import stop_between_episodes
from serp.task import BoundTask, Task

_T = TypeVar("_T")

ALGORITHMS = ("serp", "mrp", "dqn")
"""What is compared where nothing is said."""


@dataclass(frozen=True)
class Comparison:
    """A comparison on the disk.

    Attributes:
        path: Its folder; `report.md` and `report.html` lie there.
        results: The complete trials and what is measured of them.
    """

    path: Path
    results: Results

    def overview(self) -> tuple[list[str], list[list[str]]]:
        """Return a table: its head, and a row an algorithm."""
        return overview(self.results)


def compare(
    task: Task | str | None = None,
    *,
    algorithms: Iterable[str] | None = None,
    seeds: int | Iterable[int] | None = None,
    env_steps: int | None = None,
    model_variants: Iterable[str | Path] = (),
    settings: Changes | None = None,
    changed: Mapping[str, Changes] | None = None,
    threshold: float | None = None,
    evaluate_every: int | None = None,
    evaluation_episodes: int | None = None,
    final_episodes: int | None = None,
    out: str | Path | None = None,
    jobs: int | None = None,
    command: Sequence[str] | None = None,
    quiet: bool = False,
) -> Comparison:
    """Compare algorithms on one task, on equal terms.

    What was complete in `out` before is kept: with more algorithms, seeds or domain files only what
    is missing is run, and an interrupted comparison goes on.

    Args:
        task: The task, the name of an installed one, or a domain file that belongs to one. None:
            that of the comparison in `out`.
        algorithms: Names, see `serp.comparison.algorithms`; the first is what the others are
            compared with. `name:text` is one with other settings, see `changed`.
        seeds: So many seeds from 0 on, or the seeds themselves; 5 by default.
        env_steps: Budget of each trial; by default `training.env_steps` of the task.
        model_variants: Domain files for the same task, on each of which what uses a model runs
            too; see `serp.comparison.domain_files`.
        settings: Section → setting → value, changed for all of our algorithms.
        changed: Name such as `serp:learner.members=1` → what is changed for that one alone.
        threshold: Return from which a policy counts as good; by default what the environment says
            (`reward_threshold` of its Gymnasium specification), if it says anything.
        evaluate_every: Env steps between evaluations of the learner alone; a tenth of the budget by
            default.
        evaluation_episodes: Episodes of each; 10 by default.
        final_episodes: Episodes of each evaluation at the end; 50 by default.
        out: Folder of the comparison; by default `runs/compare-<domain>-<time>`.
        jobs: Processes; as many as the machine has cores by default.
        command: What the report says was typed.
        quiet: Show no progress.

    Raises:
        SerpError: Task, settings or folder are wrong, or a trial failed. Trials that are complete
            are kept, and the report is made of them.
        Interrupted: Ctrl-C; what is complete is kept.
    """
    if not isinstance(out, str | os.PathLike | None) or "\0" in str(out):
        raise SettingsError(f"out must be the name of a folder, not {out!r}")
    folder = None if out is None else Path(out)
    before = None if folder is None else read_plan(folder)
    base = _task(task, before, folder)
    count = whole(os.cpu_count() or 1 if jobs is None else jobs, 1)
    if count is None:
        raise SettingsError(f"jobs must be a whole number >= 1, not {jobs!r}")
    with base.bind() as bound:
        if folder is None:
            folder = default_path(f"compare-{bound.name}")
        with writing(folder):
            plan = _plan(
                folder, before, bound,
                algorithms=algorithms, seeds=seeds, model_variants=model_variants,
                settings=settings, changed=changed, threshold=threshold,
                conditions=_conditions(
                    before, bound, env_steps=env_steps, evaluate_every=evaluate_every,
                    evaluation_episodes=evaluation_episodes, final_episodes=final_episodes,
                ),
            )  # fmt: skip
            missing = plan.missing()
            _try_algorithms(plan, bound)
            plan.write()
            notes = judges_alike(plan, bound)
            about = _about(plan, bound, command, notes)
            failed, stopped = _run(plan, missing, count, quiet=quiet)
            records = tuple(read_trial(folder, t) for t in plan.trials if is_complete(folder, t))
            results = write_report(folder, records, about).results
    if stopped:
        raise Interrupted(
            f"stopped with {len(results.records)} of {len(plan.trials)} trials complete in {folder}"
        )
    if failed:
        raise RunError(
            f"{len(failed)} of {len(plan.trials)} trials failed; the first, {failed[0][0]}: "
            f"{failed[0][1]}\nThe others are kept in {folder}."
        )
    return Comparison(folder, results)


def _task(task: Task | str | None, before: Mapping[str, Any] | None, folder: Path | None) -> Task:
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
    name = str(before["task"])
    # As it was kept: what is installed or in the working directory may be another file.
    return dataclasses.replace(load_task(name), domain=kept_file(folder, name), problem=None)


def _conditions(
    before: Mapping[str, Any] | None, bound: BoundTask, **given: int | None
) -> Conditions:
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
        return Conditions.from_dict(conditions)
    budget = said.pop("env_steps", None)
    if budget is None:
        budget = resolve("default", bound.task.settings).training.env_steps
    every = said.pop("evaluate_every", None)
    return Conditions(
        env_steps=budget, evaluate_every=max(1, budget // 10) if every is None else every, **said
    )


def _plan(
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
    conditions: Conditions,
) -> Plan:
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
    files = domain_files(model_variants, bound.name, Path(bound.domain.source.name))
    if files and PLANNER not in now:  # what a variant is worth is what its planner is worth
        now = [*now, PLANNER]
    found = named(_unique([*known, *now]), {**known, **(changed or {})})
    variants = {bound.name: keep_domain(folder, bound.name, bound.domain, bound.task)}
    given = _by_name(files)
    for name, file in given.items():
        variants[name] = _variant(folder, name, file, bound)
    for name in old["variants"]:
        if name not in variants:
            variants[name] = _variant(folder, name, kept_file(folder, name), bound)
    trials = [Trial(str(a), str(v), int(s)) for a, v, s in old["trials"]]
    asked = {name: found[name] for name in now}
    places = [bound.name, *given] if given or before is None else [*variants]
    trials += trials_of(asked, places, _seeds(seeds, trials))
    if threshold is None:
        threshold = old.get("threshold", _threshold_of(bound))
    elif real(threshold) is None:
        raise SettingsError(f"threshold must be a number, not {threshold!r}")
    return Plan(
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


def _threshold_of(bound: BoundTask) -> float | None:
    specification = bound.env.spec
    return None if specification is None else specification.reward_threshold


def _variant(folder: Path, name: str, file: Path, bound: BoundTask) -> Task:
    """Return the task with another domain file.

    Raises:
        DomainError: The file is missing or wrong.
        TaskError: It does not fit the task.
        SettingsError: It is named like the task itself.
    """
    if name == bound.name:
        raise SettingsError(f"{file}: a model variant needs another name than the task, `{name}`")
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


def _try_algorithms(plan: Plan, bound: BoundTask) -> None:
    """Refuse before anything is run what cannot be run: settings, missing libraries.

    Raises:
        SerpError: An algorithm cannot be made.
    """
    for name, algorithm in plan.algorithms.items():
        trial = next(trial for trial in plan.trials if trial.algorithm == name)
        settings = plan.settings(trial)
        if algorithm.kind == "guest":
            make_contender(algorithm, bound, settings, trial.seed)


def _run(
    plan: Plan, missing: Sequence[Trial], processes: int, *, quiet: bool
) -> tuple[list[tuple[str, str]], bool]:
    """Run trials; return what failed, and whether the user stopped it."""
    jobs = [_job(plan, trial) for trial in missing]
    processes = min(processes, max(1, len(jobs)))
    alone = processes > 1 and not portable(jobs)
    outlook = Outlook(missing, plan.conditions.env_steps, 1 if alone else processes)
    failed: list[tuple[str, str]] = []
    if not jobs:
        return failed, False
    with stop_between_episodes() as stopping, Display(outlook, len(jobs), quiet=quiet) as display:
        if alone:
            display.say(
                "The trials run one after another: the task has functions that cannot be imported "
                "from other processes (lambdas, or functions of a notebook or of __main__)."
            )
        if alone or processes == 1:
            ends = run_here(jobs, display.notice)
        else:
            ends = run_in_processes(jobs, processes, display.notice, lambda: stopping.requested)
        for ended in ends:
            display.end(ended.trial, ended.error)
            if ended.error is not None:
                failed.append((str(tuple(ended.trial)), ended.error))
            if stopping.requested and (alone or processes == 1):
                break
        return failed, stopping.requested


def _job(plan: Plan, trial: Trial) -> Job:
    algorithm: Algorithm = plan.algorithms[trial.algorithm]
    about = {
        "env_steps": plan.conditions.env_steps,
        "settings": settings_in_use(algorithm, plan.settings(trial)),
        "description": algorithm.description,
        "made_of": plan.made_of(trial),
    }
    task = plan.variants[trial.variant]
    return Job(plan.folder, trial, algorithm, task, plan.conditions, plan.changes, about)


def _about(
    plan: Plan, bound: BoundTask, command: Sequence[str] | None, notes: Sequence[str]
) -> ComparisonAbout:
    conditions = plan.conditions
    inputs = resolve("default", bound.task.settings, plan.changes).training.inputs
    return ComparisonAbout(
        task=plan.name,
        algorithms=list(plan.algorithms),
        variants={name: f"domains/{name}.pddl" for name in plan.variants},
        base=plan.base,
        trials=plan.trials,
        env_steps=conditions.env_steps,
        seeds=plan.seeds,
        threshold=plan.threshold,
        evaluate_every=conditions.evaluate_every,
        evaluation_episodes=conditions.evaluation_episodes,
        final_episodes=conditions.final_episodes,
        rewarded_by=bound.rewarded_by,
        inputs=_INPUTS[inputs],
        command=shlex.join(command or ["serp", "compare", "--out", str(plan.folder)]),
        unit=unit_of(bound.task),
        notes=notes,
    )


_INPUTS = {
    "observation": "the observation",
    "state": "the grounded state",
    "both": "the observation and the grounded state",
}
