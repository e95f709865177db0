"""`compare`: plans the trials, runs the missing ones, and writes the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Unpack

from serp._util.extras import needs_extra
from serp.comparison.analysis.results import Results
from serp.comparison.fairness import judges_alike
from serp.comparison.folder import read_plan, write_plan, writing
from serp.comparison.metadata import metadata_of
from serp.comparison.plan import ComparisonPlan
from serp.comparison.progress import Display, RemainingTime, named_trial
from serp.comparison.report.tables import overview
from serp.comparison.request import (
    ComparisonRequest,
    requested_folder,
    requested_plan,
    requested_processes,
    requested_task,
)
from serp.comparison.trial_files import is_complete, read_trial
from serp.comparison.trial_records import Trial
from serp.comparison.trials.characteristics import settings_in_use
from serp.comparison.trials.contestant import make_contestant
from serp.comparison.workers import Job, portable, run_here, run_in_processes
from serp.errors import Interrupted, RunError
from serp.runs.new_folder import default_path
from serp.tasks.bound_task import BoundTask
from serp.tasks.task import Task
from serp.training.agent import Agent
from serp.training.stopping import Stopping, stop_between_episodes


@dataclass(frozen=True)
class Comparison:
    """A comparison on the disk.

    Attributes:
        path: Its folder, with `report.md` and `report.html`.
        results: The complete trials and their measures.
    """

    path: Path
    results: Results

    def overview(self) -> tuple[list[str], list[list[str]]]:
        """Return the main results: the titles of the columns, and one row per algorithm."""
        return overview(self.results)

    @property
    def caution(self) -> str | None:
        """A warning of too few seeds; None if there are enough."""
        return self.results.caution(*self.results.variants)


def compare(task: Task | str | None = None, **request: Unpack[ComparisonRequest]) -> Comparison:
    """Compare algorithms on one task under one protocol.

    Complete trials in `out` are kept: a call with more algorithms, seeds or domain files runs only
    the missing trials, and continues an interrupted comparison.

    Args:
        task: The task, the name of an installed one, or a domain file that belongs to one. None:
            that of the comparison in `out`.
        **request: Options, see `ComparisonRequest`.

    Raises:
        SerpError: Task, settings or folder are wrong, or a trial failed. Complete trials are kept,
            and the report covers them.
        Interrupted: Ctrl-C, SIGTERM or SIGHUP; complete trials are kept.
    """
    unknown = [name for name in request if name not in ComparisonRequest.__annotations__]
    if unknown:
        raise TypeError(f"compare() got an unexpected keyword argument {unknown[0]!r}")
    with needs_extra("report", "the report of a comparison"):
        from serp.comparison.report.report import write_report
    folder = requested_folder(request.get("out"))
    before = None if folder is None else read_plan(folder)
    base = requested_task(task, before, folder)
    processes = requested_processes(request.get("jobs"))
    with base.bind() as bound:
        if folder is None:
            folder = default_path(f"compare-{bound.name}")
        with writing(folder):
            if read_plan(folder) != before:
                raise RunError(
                    f"another process has changed {folder} just now. Run the command again."
                )
            plan = requested_plan(folder, before, bound, request)
            missing = plan.missing()
            _try_algorithms(plan, bound)
            write_plan(folder, plan.saved())
            metadata = metadata_of(plan, bound, judges_alike(plan, bound))
            with stop_between_episodes() as stopping:
                quiet = request.get("quiet", False)
                failed = _run(plan, missing, processes, stopping, quiet=quiet)
                done = [trial for trial in plan.trials if is_complete(folder, trial)]
                results = Results([read_trial(folder, trial) for trial in done], metadata)
                write_report(folder, results)
    if stopping.signal is not None and len(done) + len(failed) < len(plan.trials):
        raise Interrupted(
            f"stopped with {len(done)} of {len(plan.trials)} trials complete in {folder}",
            stopping.signal,
        )
    if failed:
        raise RunError(
            f"{len(failed)} of {len(plan.trials)} trials failed; the first, {failed[0][0]}: "
            f"{failed[0][1]}\nThe others are kept in {folder}."
        )
    return Comparison(folder, results)


def _try_algorithms(plan: ComparisonPlan, bound: BoundTask) -> None:
    """Make each algorithm once, so that errors occur before any trial runs.

    Raises:
        SerpError: An algorithm cannot be made, or its settings are wrong.
    """
    for name, algorithm in plan.algorithms.items():
        trial = next(trial for trial in plan.trials if trial.algorithm == name)
        settings = plan.settings(trial)
        if algorithm.kind == "external":
            make_contestant(algorithm, bound, settings, trial.seed)
        else:
            Agent(bound, settings, trial.seed)


def _run(
    plan: ComparisonPlan,
    missing: Sequence[Trial],
    processes: int,
    stopping: Stopping,
    *,
    quiet: bool,
) -> list[tuple[str, str]]:
    """Run trials until a signal; return the failed ones, each with its error."""
    failed: list[tuple[str, str]] = []
    if not missing:
        return failed
    processes = min(processes, len(missing))
    jobs = [_job(plan, trial) for trial in missing]
    here = processes > 1 and not portable(jobs)
    processes = 1 if here else processes
    remaining = RemainingTime(missing, plan.protocol.env_steps, processes)
    with Display(remaining, len(missing), quiet=quiet) as display:
        if here:
            display.say(
                "The trials run one after another: the task has functions that cannot be imported "
                "from other processes (lambdas, or functions of a notebook or of __main__)."
            )

        def stopped() -> bool:
            return stopping.requested

        def on_progress(trial: Trial, env_steps: int) -> None:
            answer = stopping.answer(
                "the trials that run", "they are run again when the comparison goes on"
            )
            if answer is not None:
                display.say(answer)
            display.notice(trial, env_steps)

        if processes == 1:
            ends = run_here(jobs, on_progress, stopped)
        else:
            ends = run_in_processes(jobs, processes, on_progress, stopped)
        for ended in ends:
            display.end(ended.trial, ended.error)
            if ended.error is not None:
                failed.append((named_trial(ended.trial), ended.error))
        return failed


def _job(plan: ComparisonPlan, trial: Trial) -> Job:
    """Return what a worker needs for one trial."""
    algorithm = plan.algorithms[trial.algorithm]
    metadata = {
        "env_steps": plan.protocol.env_steps,
        "settings": settings_in_use(algorithm, plan.settings(trial)),
        "description": algorithm.description,
        "made_of": plan.made_of(trial),
    }
    return Job(
        plan.folder, trial, algorithm, plan.variants[trial.variant], plan.protocol, plan.changes,
        metadata,
    )  # fmt: skip
