"""`compare`: plans the trials, runs the missing ones, and writes the report.

comparison/plan.json     everything that was requested so far, with the texts of the domain files
comparison/trials/NAME/  the trials, each a run folder
comparison/report.html   the report, see `serp.runs.comparison.report`
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    PositiveInt,
    ValidationError,
    field_validator,
)

from serp._util.did_you_mean import did_you_mean
from serp._util.files import make_inside, read_regular, write_durably
from serp.agent.agent import Agent
from serp.errors import Interrupted, Notice, RunError, SettingsError, TaskError, needs_extra
from serp.model.domain import Domain, load_domain
from serp.pddl.source import Source
from serp.runs.comparison.algorithms import DQN, PLANNER, find_algorithm
from serp.runs.comparison.pool import TrialsRequest, progress, run_jobs
from serp.runs.comparison.statistics import Results
from serp.runs.comparison.trial import (
    ExternalEnv,
    Job,
    Record,
    Trial,
    TrialProtocol,
    file_name,
    make_external,
    read_trial,
)
from serp.runs.folder import RunLock, default_path, make_empty
from serp.runs.train import stop_between_episodes
from serp.settings import Changes, resolve
from serp.tasks.environment import BoundTask
from serp.tasks.registry import find_domain_file, find_task, load_task, task_entries
from serp.tasks.task import Task

_PLAN: Final = "plan.json"


class CompareSettings(TrialsRequest):
    """The options of `serp.compare`, which describes them; None stands for the default."""

    algorithms: tuple[str, ...] = ()
    env_steps: PositiveInt | None = None
    threshold: FiniteFloat | None = None
    evaluate_every: PositiveInt | None = None
    evaluation_episodes: PositiveInt | None = None
    final_episodes: PositiveInt | None = None

    @field_validator("algorithms", mode="before")
    @classmethod
    def _names(cls, value: Any) -> Any:
        if isinstance(value, str | os.PathLike) or not isinstance(value, Iterable):
            raise ValueError("must be a list of names, such as ['serp', 'dqn']")
        return tuple(dict.fromkeys(map(str, value)))


class ComparisonPlan(BaseModel):
    """The content of `plan.json`: everything that was requested of a comparison so far.

    Attributes:
        algorithms: Their names; the others are compared with the first.
        domains: Name of each domain file → its text, and that of its problem file. The first is the
            task's own; the others are named by algorithms.
        settings: Changes to the settings of all algorithms, JSON values.
        threshold: Return from which a policy counts as good; None for none.
        max_ground_schemas: Limit on the size of the grounded domains.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="constants")

    format: Literal[4] = 4
    task: str
    algorithms: tuple[str, ...]
    domains: dict[str, tuple[str, ...]] = Field(min_length=1)
    seeds: tuple[int, ...]
    protocol: TrialProtocol
    settings: dict[str, dict[str, Any]]
    threshold: float | None
    max_ground_schemas: int

    def domain(self, name: str, *, observed: bool) -> Domain:
        """Return one of the domains."""
        texts = zip((f"{name}.pddl", f"{name}-problem.pddl"), self.domains[name], strict=False)
        sources = [Source(*each) for each in texts]
        limit = self.max_ground_schemas
        return Domain.parse(*sources, observed=observed, max_ground_schemas=limit)


def _plain(changes: Changes) -> dict[str, dict[str, Any]]:
    """Return settings as they are read back: JSON has no tuples."""
    plain: dict[str, dict[str, Any]] = json.loads(json.dumps(changes))
    return plain


def read_plan(folder: Path) -> ComparisonPlan | None:
    """Return the plan of a comparison; None if the folder holds none."""
    file = folder / _PLAN
    if not file.is_file():
        return None
    try:
        return ComparisonPlan.model_validate_json(read_regular(file))
    except ValidationError:
        raise RunError(
            f"{file} is damaged, or of another version of serp. Restore it from a copy, or compare "
            "in another folder (--out)."
        ) from None


# The folder ------------------------------------------------------------------------------------


@contextlib.contextmanager
def locked(folder: Path, mark: str) -> Iterator[None]:
    """Create a folder, unless it has the file `mark` or is empty, and lock it.

    Raises:
        RunError: It cannot be created, holds other files, or another process writes it.
    """
    if not (folder / mark).is_file():
        make_empty(folder)
    lock = RunLock(folder)
    try:
        yield
    finally:
        lock.release()


# The plan --------------------------------------------------------------------------------------


def _requested_task(
    task: Task | str | None, before: ComparisonPlan | None, folder: Path | None
) -> Task:
    if isinstance(task, Task):
        return task
    if isinstance(task, str):
        return find_task(task)
    if task is not None:
        raise TaskError(f"a task is a serp.Task, a name or a domain file, not {task!r}")
    if folder is None:
        raise RunError("say what to compare on: name a task")
    if before is None:
        raise RunError(f"say what to compare on: name a task; {folder} holds no comparison yet")
    if before.task not in task_entries():
        raise TaskError(
            f"{folder} compares on task {before.task}, which is not installed: name it again, as a "
            "serp.Task (--task), or by the domain file that is its world (--domain)"
        )
    # The text of the plan, because the original file may have changed.
    found = load_task(before.task)
    domain = before.domain(next(iter(before.domains)), observed=not found.closed)
    return dataclasses.replace(found, domain=domain, problem=None)


def _planned(
    folder: Path, before: ComparisonPlan | None, bound: BoundTask, request: CompareSettings
) -> tuple[ComparisonPlan, dict[str, Task]]:
    """Return the existing plan extended by a request, and the task with each domain file."""
    asked = request.model_dump(include={*TrialProtocol.model_fields}, exclude_none=True)
    if before is None:
        specification = bound.env.spec
        steps = request.env_steps or resolve("default", bound.task.settings).training.env_steps
        asked = {"env_steps": steps, "evaluate_every": max(1, steps // 10), **asked}
        before = ComparisonPlan(
            task=bound.name,
            algorithms=request.algorithms or ("serp", PLANNER, DQN),
            domains={Path(bound.domain.source.name).stem: _texts(bound.domain)},
            seeds=request.seeds or tuple(range(5)),
            protocol=TrialProtocol(**asked),
            settings=_plain(request.settings),
            threshold=None if specification is None else specification.reward_threshold,
            max_ground_schemas=bound.domain.max_ground_schemas,
        )
    else:
        _refuse_contradictions(folder, before, bound, request, asked)
    algorithms = tuple(dict.fromkeys((*before.algorithms, *request.algorithms)))
    tasks = _tasks(before, bound, {find_algorithm(name).domain for name in algorithms} - {""})
    domains = {name: _texts(task.load()) for name, task in tasks.items()}
    for name, texts in domains.items():
        if before.domains.get(name, texts) != texts:
            raise RunError(
                f"the domain file `{name}` was edited since this comparison began. Compare in "
                "another folder (--out)."
            )
    update: dict[str, Any] = {
        "algorithms": algorithms,
        "domains": domains,
        "seeds": tuple(sorted({*before.seeds, *request.seeds})),
    }
    if request.threshold is not None:
        update["threshold"] = request.threshold
    return before.model_copy(update=update), tasks


def _texts(domain: Domain) -> tuple[str, ...]:
    return tuple(source.text for source in domain.sources)


def _refuse_contradictions(
    folder: Path,
    before: ComparisonPlan,
    bound: BoundTask,
    request: CompareSettings,
    asked: Mapping[str, int],
) -> None:
    """Raise a SerpError for a request that differs from the existing plan."""
    if before.task != bound.name:
        raise RunError(f"{folder} compares on task {before.task}, not on {bound.name}")
    if request.settings and _plain(request.settings) != before.settings:
        raise SettingsError(
            "settings of a comparison cannot change once it has begun. Compare in another folder "
            "(--out)."
        )
    for name, value in asked.items():
        if (own := getattr(before.protocol, name)) != value:
            raise SettingsError(
                f"this comparison has {name} = {own}, not {value}: all of its trials have the same "
                "protocol. Compare in another folder (--out)."
            )


def _tasks(plan: ComparisonPlan, bound: BoundTask, names: Iterable[str]) -> dict[str, Task]:
    """Return the loaded task with each domain file, its own first.

    A name means what it means for `find_task`, or a file beside the task's own. One that is gone is
    the plan's.

    Raises:
        SerpError: There is no such file, or it does not fit the task.
    """
    own = Path(bound.domain.source.name)
    tasks, observed = {next(iter(plan.domains)): bound.task.loaded()}, not bound.task.closed
    for name in sorted({*names} - {*tasks}):
        file = find_domain_file(name) or own.with_name(f"{name}.pddl")
        if file.is_file():
            limit = plan.max_ground_schemas
            domain = load_domain(file, observed=observed, max_ground_schemas=limit)
        elif name in plan.domains:
            domain = plan.domain(name, observed=observed)
        else:
            known = sorted(path.stem for path in own.parent.glob("*.pddl") if path != own)
            raise TaskError(f"there is no domain file {name}; {did_you_mean(name, known)}")
        # Binding checks that the file fits the task.
        with dataclasses.replace(bound.task, domain=domain, problem=None).bind() as other:
            tasks[name] = other.task.loaded()
    return tasks


def _jobs(folder: Path, plan: ComparisonPlan, tasks: Mapping[str, Task]) -> list[Job]:
    """Return the jobs of all trials, seed by seed.

    Raises:
        RunError: A trial that was begun was made from other settings or files.
    """
    own, place, jobs = next(iter(tasks)), folder.absolute() / "trials", []
    for algorithm in map(find_algorithm, plan.algorithms):
        task = tasks[algorithm.domain or own]
        settings = algorithm.settings(task, plan.settings)
        for seed in plan.seeds:
            trial_folder = place / f"{file_name(algorithm.name)}-{seed}"
            trial = Trial(algorithm.name, seed)
            jobs.append(Job(trial, algorithm, task, settings, plan.protocol, trial_folder))
    for job in jobs:
        if job.begun:
            job.refuse_changes()
    return sorted(jobs, key=lambda job: job.trial.seed)


def _check_algorithms(jobs: Sequence[Job], bound: BoundTask) -> None:
    """Make each algorithm once, so that errors occur before any trial runs."""
    for job in {job.trial.algorithm: job for job in jobs}.values():
        agent = Agent(bound, job.settings, job.trial.seed)
        if job.algorithm.make_external is not None:
            env = ExternalEnv(bound, agent, job.trial.seed)
            make_external(job.algorithm, env, bound.name, job.trial.seed)


def _notes(records: Iterable[Record]) -> list[str]:
    """Return a warning if trials were made with different versions of a package."""
    versions: dict[str, set[str]] = {}
    for record in records:
        for name, version in record.versions.items():
            versions.setdefault(name, set()).add(version or "not installed")
    differ = [f"{name} ({', '.join(sorted(v))})" for name, v in versions.items() if len(v) > 1]
    return differ and [
        f"The trials were made with different versions of {', '.join(differ)}: equal seeds need "
        "not give equal numbers."
    ]


@dataclass(frozen=True)
class Comparison:
    """A comparison on the disk.

    Attributes:
        path: Its folder, with `report.html`.
        results: The complete trials and their measures.
    """

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
            installed task is a world, as `serp.file_task` makes it. None: that of the comparison in
            `out`.
        **options: All of them optional. When a comparison is continued, the defaults are its own
            values.

            * `algorithms`: names, such as `serp`, `mrp`, `dqn` or `ppo`; the others are compared
              with the first. `serp:learner.members=1` is `serp` with a setting changed, and
              `serp@cartpole-reversed` is `serp` with another domain file of the task. By default
              `serp`, `mrp` and `dqn`.
            * `seeds`: number of seeds, from 0 on, or a list of seeds; 5 by default.
            * `env_steps`: budget of each trial; by default `training.env_steps` of the task.
            * `settings`: section → setting → value; applies to all of serp's algorithms.
            * `threshold`: return from which a policy counts as good; by default the
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
    out = request.out
    before = None if out is None else read_plan(out)
    with _requested_task(task, before, out).bind() as bound:
        folder = out or default_path(f"compare-{bound.name}")
        plan, tasks = _planned(folder, before, bound, request)
        jobs = _jobs(folder, plan, tasks)
        _check_algorithms(jobs, bound)
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
            notes = _notes(results.records)
            for note in notes:
                warnings.warn(note, Notice, stacklevel=2)
            write_report(folder, results, jobs, notes)
    complete = len(results.records)
    if stopping.signal is not None and complete + len(failed) < len(jobs):
        raise Interrupted(
            f"stopped with {complete} of {len(jobs)} trials complete in {folder}",
            stopping.signal,
        )
    if failed:
        raise RunError(
            f"{len(failed)} of {len(jobs)} trials failed; the first, {failed[0]}\n"
            f"The others are kept in {folder}."
        )
    return Comparison(folder, results)
