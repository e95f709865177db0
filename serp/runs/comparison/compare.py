"""`compare`: plans the trials, runs the missing ones, and writes the report.

comparison/plan.json     everything that was requested so far
comparison/trials/NAME/  the trials, each a run folder
comparison/report.html   the report, see `serp.runs.comparison.report`
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, PositiveInt, ValidationError

from serp._util.files import make_inside, read_regular, write_durably
from serp.agent.agent import Agent
from serp.errors import Interrupted, RunError, SettingsError, needs_extra
from serp.model.domain import load_domain
from serp.runs.comparison.algorithms import BASELINE, DQN, PLANNER, find_algorithm
from serp.runs.comparison.pool import TrialsRequest, progress, run_jobs
from serp.runs.comparison.statistics import Results
from serp.runs.comparison.trial import Job, TrialProtocol, file_name, make_external, read_trial
from serp.runs.folder import default_path, lock_folder, make_empty
from serp.runs.train import stop_between_episodes
from serp.settings import resolve
from serp.tasks.environment import BoundTask
from serp.tasks.registry import find_domain_file, find_task
from serp.tasks.task import Task

_PLAN: Final = "plan.json"


class CompareSettings(TrialsRequest):
    """The options of `serp.compare`, which describes them; None stands for the default."""

    algorithms: tuple[str, ...] = Field((), strict=False)
    baseline: str | None = None
    env_steps: PositiveInt | None = None
    threshold: FiniteFloat | None = None
    evaluate_every: PositiveInt | None = None
    evaluation_episodes: PositiveInt | None = None
    final_episodes: PositiveInt | None = None


class ComparisonPlan(BaseModel):
    """The content of `plan.json`: everything that was requested of a comparison so far."""

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="constants")

    format: Literal[5] = 5
    task: str
    algorithms: tuple[str, ...]
    seeds: tuple[int, ...]
    protocol: TrialProtocol
    settings: dict[str, dict[str, Any]]
    threshold: float | None


def read_plan(folder: Path) -> ComparisonPlan | None:
    """Return the plan of a comparison; None if the folder holds none."""
    file = folder / _PLAN
    if not file.is_file():
        return None
    try:
        return ComparisonPlan.model_validate_json(read_regular(file))
    except ValidationError:
        raise RunError(
            f"{file} is damaged, or was written by another version of serp. Restore it from a "
            "copy, or compare in another folder (--out)."
        ) from None


@contextlib.contextmanager
def locked(folder: Path, mark: str) -> Iterator[None]:
    """Create a folder, unless it has the file `mark` or is empty, and lock it; see `make_empty`."""
    if not (folder / mark).is_file():
        make_empty(folder)
    lock = lock_folder(folder)
    try:
        yield
    finally:
        lock.release()


def _planned(
    before: ComparisonPlan | None, bound: BoundTask, request: CompareSettings
) -> ComparisonPlan:
    """Return the plan extended by a request of the same task and protocol, or a new one."""
    asked = request.model_dump(include={*TrialProtocol.model_fields}, exclude_none=True)
    if before is None:
        specification = bound.env.spec
        steps = request.env_steps or resolve("default", bound.task.settings).training.env_steps
        asked = {"env_steps": steps, "evaluate_every": max(1, steps // 10), **asked}
        before = ComparisonPlan(
            task=bound.name,
            algorithms=request.algorithms or ("serp", PLANNER, DQN),
            seeds=request.seeds or tuple(range(5)),
            protocol=TrialProtocol(**asked),
            settings={},
            threshold=None if specification is None else specification.reward_threshold,
        )
    own = {"task": before.task, **before.protocol.model_dump()}
    for name, value in {"task": bound.name, **asked}.items():
        if own[name] != value:
            raise SettingsError(
                f"this comparison has {name} = {own[name]}, not {value}: its trials must share one "
                "task and protocol. Compare in another folder (--out)."
            )
    own_baseline = () if request.baseline is None else (f"{BASELINE}{request.baseline}",)
    names = dict.fromkeys((*before.algorithms, *request.algorithms, *own_baseline))
    update = {
        "algorithms": tuple(names),
        "seeds": tuple(sorted({*before.seeds, *request.seeds})),
        "settings": request.settings or before.settings,
        "threshold": before.threshold if request.threshold is None else request.threshold,
    }
    return before.model_copy(update=update)


def _with_domain_file(bound: BoundTask, name: str) -> Task:
    """Return the loaded task with another domain file, also one beside its own, if it is named."""
    if not name:
        return bound.task.loaded()
    own, limit = Path(bound.domain.source.name), bound.domain.max_ground_schemas
    file = find_domain_file(name) or own.with_name(f"{name}.pddl")
    domain = load_domain(file, observed=not bound.task.closed, max_ground_schemas=limit)
    # Binding checks that the file fits the task.
    with dataclasses.replace(bound.task, domain=domain, problem=None).bind() as other:
        return other.task.loaded()


def _jobs(folder: Path, plan: ComparisonPlan, bound: BoundTask) -> list[Job]:
    """Return the jobs of all trials, seed by seed; each algorithm is made once, to meet errors."""
    place, jobs = folder.absolute() / "trials", []
    for algorithm in map(find_algorithm, plan.algorithms):
        task = _with_domain_file(bound, algorithm.domain)
        if algorithm.advise is not None:
            own = {**task.planners, algorithm.name: algorithm.advise}
            task = dataclasses.replace(task, planners=own)
        settings = algorithm.settings(task, plan.settings)
        if algorithm.make_external is None:
            with task.bind() as other:
                Agent(other, settings, plan.seeds[0])
        else:
            *_, external = make_external(algorithm, bound, settings, plan.seeds[0])
            first = getattr(external, "first_update", 0)
            if first > plan.protocol.env_steps:
                raise SettingsError(
                    f"`{algorithm.name}` first learns after {first:,} env steps, "
                    f"but the budget is {plan.protocol.env_steps:,}, so it would learn nothing. "
                    f"Give at least --env-steps {first}, or leave the algorithm out."
                )
        for seed in plan.seeds:
            trial_folder = place / f"{file_name(algorithm.name)}-{seed}"
            jobs.append(Job(algorithm, seed, task, settings, plan.protocol, trial_folder))
    for job in jobs:
        if job.begun:
            job.refuse_changes()
    return sorted(jobs, key=lambda job: job.seed)


@dataclass(frozen=True)
class Comparison:
    """A comparison on the disk: its folder with `report.html`, and the complete trials."""

    path: Path
    results: Results

    def overview(self) -> tuple[list[str], list[list[str]]]:
        """Return the main results: the titles of the columns, and one row per algorithm."""
        from serp.runs.comparison.report import overview

        return overview(self.results)


def compare(task: Task | str | None = None, **options: Any) -> Comparison:
    """Compare algorithms on one task under one protocol.

    Every trial is a run folder in `out`, which `serp why`, `serp report` and `serp evaluate` open.
    Complete trials are kept: a call with more algorithms or seeds runs only the missing
    trials, and interrupted ones go on from their last checkpoint.

    Args:
        task: The task, the name of an installed one, or a domain file; one that belongs to no
            installed task is a world, as `serp.file_task` makes it. None: the installed task of
            the comparison in `out`.
        **options: All of them optional. When a comparison is continued, the defaults are its own
            values.

            * `algorithms`: names, such as `serp`, `mrp`, `dqn` or `ppo`; the others are compared
              with the first. `serp:learner.members=1` is `serp` with a setting changed, and
              `serp@cartpole-reversed` is `serp` with another domain file of the task. By default
              `serp`, `mrp` and `dqn`.
            * `baseline`: a controller of your own to compare with, `FILE.py:FUNCTION` or
              `MODULE:FUNCTION`: a function as in `serp.Task.planners`.
            * `seeds`: number of seeds, from 0 on, or a list of seeds; 5 by default.
            * `env_steps`: budget of each trial; by default `training.env_steps` of the task.
            * `settings`: section → setting → value; applies to all of serp's algorithms.
            * `threshold`: return at which a policy counts as good; by default the
              `reward_threshold` of the environment's Gymnasium specification, if it has one.
            * `evaluate_every`: env steps between evaluations of the learner; a tenth of the budget
              by default.
            * `evaluation_episodes`: episodes of each such evaluation; 10 by default.
            * `final_episodes`: episodes of each evaluation at the end; 50 by default.
            * `out`: folder of the comparison; by default `runs/compare-<domain>-<time>`.
            * `engine`: what runs the trials: `local` (the default), `ray`, or the name of another
              entry point of the group `serp.engines`.
            * `address`: the cluster that the engine is to use; by default it starts workers here.
            * `jobs`: most trials at the same time; by default the number of cores.
            * `quiet`: show no progress.

    Raises:
        SerpError: Task, options, settings or folder are wrong, or a trial failed. Complete trials
            are kept, and the report covers them.
        Interrupted: Ctrl-C, SIGTERM or SIGHUP; the trials are kept.
    """
    with needs_extra("report", "the report of a comparison"):
        from serp.runs.comparison.report import write_report
    request = CompareSettings(**options)
    before = None if request.out is None else read_plan(request.out)
    if task is None:
        if before is None:
            raise RunError("no task is given; name one, such as --domain cartpole")
        task = before.task
    with find_task(task).bind() as bound:
        folder = request.out or default_path(f"compare-{bound.name}")
        plan = _planned(before, bound, request)
        jobs = _jobs(folder, plan, bound)
    with locked(folder, _PLAN):
        if read_plan(folder) != before:
            raise RunError(f"another process has changed {folder} just now. Try again.")
        make_inside(folder, "trials")
        write_durably(folder / _PLAN, plan.model_dump_json(indent=1))
        missing = [job for job in jobs if not job.complete]
        failed: list[str] = []
        with stop_between_episodes() as stopping, progress("comparing", request.quiet) as say:
            for count, ended in enumerate(run_jobs(missing, request, stopping, say), 1):
                how = f": failed. {ended.error}" if ended.error else ": stopped"
                how = how if ended.error or ended.stopped else ""
                say(f"[{count}/{len(missing)}] {ended.job.trial}{how}")
                if ended.error:
                    failed.append(f"{ended.job.trial}: {ended.error}")
            results = Results((read_trial(job) for job in jobs if job.complete), plan)
            write_report(folder, results, jobs)
    complete = len(results.records)
    if stopping.signal is not None and complete + len(failed) < len(jobs):
        raise Interrupted(
            f"stopped with {complete} of {len(jobs)} trials complete in {folder}.\n"
            f"Continue with the same command and --out {folder}.",
            stopping.signal,
        )
    if failed:
        raise RunError(
            f"{len(failed)} of {len(jobs)} trials failed. The first failure: {failed[0]}\n"
            f"All trials are kept in {folder}."
        )
    return Comparison(folder, results)
