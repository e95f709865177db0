"""`compare`: plans the trials, runs the missing ones, and writes the report."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from serp.comparison.analysis.results import Results
from serp.comparison.engines import ONE_AFTER_ANOTHER, at_once, open_pool, runs_here
from serp.comparison.fairness import judges_alike, made_alike
from serp.comparison.folder import writing
from serp.comparison.merging import merge_into
from serp.comparison.metadata import metadata_of
from serp.comparison.plan import read_plan, write_plan
from serp.comparison.prepared import PreparedComparison
from serp.comparison.progress import Display
from serp.comparison.report.tables import overview
from serp.comparison.request import ComparisonRequest, prepare, requested_task
from serp.comparison.trial_files import is_complete, read_trial, write_trial
from serp.comparison.trial_records import Trial
from serp.comparison.trials.contestant import make_contestant
from serp.comparison.workers import Ended, run_here, run_in_executor
from serp.errors import Interrupted, Notice, RunError, needs_extra
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
        return self.results.caution


def compare(task: Task | str | None = None, **options: Any) -> Comparison:
    """Compare algorithms on one task under one protocol.

    Complete trials in `out` are kept: a call with more algorithms, seeds or domain files runs only
    the missing trials, and continues an interrupted comparison.

    Args:
        task: The task, the name of an installed one, or a domain file; one that belongs to no
            installed task is a world, as `serp.file_task` makes it. None: that of the comparison in
            `out`.
        **options: All of them optional. When a comparison is continued, the defaults are its own
            values.

            * `algorithms`: names, such as `serp`, `mrp`, `dqn` or `ppo`; the others are compared
              with the first. `name:text` is an algorithm with other settings, see `changed`. By
              default `serp`, `mrp` and `dqn`.
            * `seeds`: number of seeds, from 0 on, or a list of seeds; 5 by default.
            * `env_steps`: budget of each trial; by default `training.env_steps` of the task.
            * `model_variants`: further domain files for the task; every algorithm that uses a model
              also runs on each of them. Files, names of files beside the task's own domain file
              (`cartpole-reversed`), patterns of either, or `all`: every file there whose name
              begins with that of the task and a hyphen.
            * `settings`: section → setting → value; applies to all of serp's algorithms.
            * `changed`: name such as `serp:learner.members=1` → changes for that algorithm only.
            * `threshold`: return from which a policy counts as good; by default the
              `reward_threshold` of the environment's Gymnasium specification, if it has one.
            * `evaluate_every`: env steps between evaluations of the learner; a tenth of the budget
              by default.
            * `evaluation_episodes`: episodes of each such evaluation; 10 by default.
            * `final_episodes`: episodes of each evaluation at the end; 50 by default.
            * `out`: folder of the comparison; by default `runs/compare-<domain>-<time>`.
            * `engine`: what runs the trials: `local` (the default), `ray`, `dask`, or the name of
              another entry point of the group `serp.engines`.
            * `address`: the cluster that the engine is to use; by default it starts workers here.
            * `jobs`: most trials at the same time; by default the number of cores.
            * `merge`: folders of other comparisons whose trials are copied into `out` first.
            * `quiet`: show no progress.

    Raises:
        SerpError: Task, options, settings or folder are wrong, or a trial failed. Complete trials
            are kept, and the report covers them.
        Interrupted: Ctrl-C, SIGTERM or SIGHUP; complete trials are kept.
    """
    with needs_extra("report", "the report of a comparison"):
        from serp.comparison.report.report import write_report
    request = ComparisonRequest(**options)
    if request.merge:
        if request.out is None:
            raise RunError("say which folder the others are merged into: out (--out)")
        with writing(request.out):
            merge_into(request.out, request.merge)
    before = None if request.out is None else read_plan(request.out)
    with requested_task(task, before, request.out).bind() as bound:
        folder = request.out or default_path(f"compare-{bound.name}")
        with writing(folder):
            if read_plan(folder) != before:
                raise RunError(
                    f"another process has changed {folder} just now. Run the command again."
                )
            prepared = prepare(folder, before, bound, request)
            missing = prepared.missing()
            _try_algorithms(prepared, bound)
            write_plan(folder, prepared.plan)
            metadata = metadata_of(prepared, bound, judges_alike(prepared, bound))
            with stop_between_episodes() as stopping:
                failed = _run(prepared, missing, stopping, request)
                trials = prepared.plan.trials
                done = [trial for trial in trials if is_complete(folder, trial)]
                records = [read_trial(folder, trial) for trial in done]
                if mixed := made_alike(records):
                    warnings.warn(mixed[0], Notice, stacklevel=2)
                notes = [*metadata.notes, *mixed]
                results = Results(records, dataclasses.replace(metadata, notes=notes))
                write_report(folder, results)
    if stopping.signal is not None and len(done) + len(failed) < len(trials):
        raise Interrupted(
            f"stopped with {len(done)} of {len(trials)} trials complete in {folder}",
            stopping.signal,
        )
    if failed:
        raise RunError(
            f"{len(failed)} of {len(trials)} trials failed; the first, {failed[0].trial}: "
            f"{failed[0].error}\nThe others are kept in {folder}."
        )
    return Comparison(folder, results)


def _try_algorithms(prepared: PreparedComparison, bound: BoundTask) -> None:
    """Make each algorithm once, so that errors occur before any trial runs."""
    for name, algorithm in prepared.algorithms.items():
        trial = next(trial for trial in prepared.plan.trials if trial.algorithm == name)
        settings = prepared.settings(trial)
        if algorithm.kind == "external":
            make_contestant(algorithm, bound, settings, trial.seed)
        else:
            Agent(bound, settings, trial.seed)


def _run(
    prepared: PreparedComparison,
    missing: Sequence[Trial],
    stopping: Stopping,
    request: ComparisonRequest,
) -> list[Ended]:
    """Run trials until a signal; return how the failed ones ended."""
    failed: list[Ended] = []
    if not missing:
        return failed
    jobs = [prepared.job(trial) for trial in missing]
    engine = request.engine
    most = at_once(engine, request.jobs, len(jobs))
    env_steps = prepared.plan.protocol.env_steps
    with Display(missing, env_steps, quiet=request.quiet) as display, ExitStack() as stack:
        here = runs_here(engine, jobs, most)
        if here and most != 1:
            display.say(ONE_AFTER_ANOTHER)

        def stopped() -> bool:
            answer = stopping.answer(
                "the trials that run", "they are run again when the comparison goes on"
            )
            if answer is not None:
                display.say(answer)
            return stopping.requested

        def on_progress(trial: Trial, env_steps: int) -> None:
            stopped()
            display.notice(trial, env_steps)

        if here:
            ends = run_here(jobs, on_progress, stopped)
        else:
            pool = stack.enter_context(open_pool(engine, request.address, most))
            ends = run_in_executor(jobs, pool, on_progress, stopped)
        for ended in ends:
            error = _keep(prepared, ended)
            display.end(ended.trial, error)
            if error is not None:
                failed.append(ended._replace(error=error))
    return failed


def _keep(prepared: PreparedComparison, ended: Ended) -> str | None:
    """Write a trial that was measured; return what went wrong, if anything did."""
    if ended.measured is not None:
        metadata = prepared.metadata(ended.trial)
        try:
            write_trial(prepared.folder, ended.trial, ended.measured, metadata)
        except RunError as error:
            return str(error)
    return ended.error
