"""Comparing: `compare` plans the trials, runs those that are missing, and writes the report."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from serp._util.numbers import whole
from serp.compare.algorithms import Algorithm, Changes
from serp.compare.analysis.results import Results
from serp.compare.fairness import judges_alike
from serp.compare.folder import writing
from serp.compare.plan import ComparisonPlan, kept_file, read_plan
from serp.compare.progress import Display, RemainingTime, named_trial
from serp.compare.records import Trial
from serp.compare.report.metadata import ComparisonAbout
from serp.compare.report.report import overview, write_report
from serp.compare.request import conditions_asked, plan_asked, task_asked
from serp.compare.rerun_command import command
from serp.compare.storage import is_complete, read_trial
from serp.compare.trials.contestant import make_contestant
from serp.compare.trials.terms import settings_in_use
from serp.compare.trials.trial import unit_of
from serp.compare.workers import Job, portable, run_here, run_in_processes
from serp.errors import Interrupted, RunError, SettingsError
from serp.runs.placement import default_path
from serp.settings import resolve
from serp.tasks.bound_task import BoundTask
from serp.tasks.reward import reward_source
from serp.tasks.task import Task
from serp.training.stopping import Stopping, stop_between_episodes


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

    @property
    def caution(self) -> str | None:
        """What to beware of in intervals and verdicts: few seeds; None for nothing."""
        return self.results.caution(*self.results.variants)


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
    quiet: bool = False,
) -> Comparison:
    """Compare algorithms on one task, on equal terms.

    What was complete in `out` before is kept: with more algorithms, seeds or domain files only what
    is missing is run, and an interrupted comparison goes on.

    Args:
        task: The task, the name of an installed one, or a domain file that belongs to one. None:
            that of the comparison in `out`.
        algorithms: Names, see `serp.compare.algorithms`; the first is what the others are
            compared with. `name:text` is one with other settings, see `changed`.
        seeds: So many seeds from 0 on, or the seeds themselves; 5 by default.
        env_steps: Budget of each trial; by default `training.env_steps` of the task.
        model_variants: Domain files for the same task, on each of which what uses a model runs
            too; see `serp.compare.domain_files`.
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
        quiet: Show no progress.

    Raises:
        SerpError: Task, settings or folder are wrong, or a trial failed. Trials that are complete
            are kept, and the report is made of them.
        Interrupted: Ctrl-C, SIGTERM or SIGHUP; what is complete is kept.
    """
    if not isinstance(out, str | os.PathLike | None) or "\0" in str(out):
        raise SettingsError(f"out must be the name of a folder, not {out!r}")
    folder = None if out is None else Path(out)
    before = None if folder is None else read_plan(folder)
    base = task_asked(task, before, folder)
    count = whole(os.cpu_count() or 1 if jobs is None else jobs, 1)
    if count is None:
        raise SettingsError(f"jobs must be a whole number >= 1, not {jobs!r}")
    with base.bind() as bound:
        if folder is None:
            folder = default_path(f"compare-{bound.name}")
        with writing(folder):
            if read_plan(folder) != before:
                raise RunError(
                    f"another process has changed {folder} just now. Run the command again."
                )
            plan = plan_asked(
                folder, before, bound,
                algorithms=algorithms, seeds=seeds, model_variants=model_variants,
                settings=settings, changed=changed, threshold=threshold,
                conditions=conditions_asked(
                    before, bound, env_steps=env_steps, evaluate_every=evaluate_every,
                    evaluation_episodes=evaluation_episodes, final_episodes=final_episodes,
                ),
            )  # fmt: skip
            missing = plan.missing()
            _try_algorithms(plan, bound)
            plan.write()
            notes = judges_alike(plan, bound)
            about = _about(plan, bound, notes)
            with stop_between_episodes() as stopping:
                failed = _run(plan, missing, count, stopping, quiet=quiet)
                done = (trial for trial in plan.trials if is_complete(folder, trial))
                records = tuple(read_trial(folder, trial) for trial in done)
                results = write_report(folder, records, about).results
    if stopping.signal is not None and len(results.records) + len(failed) < len(plan.trials):
        raise Interrupted(
            f"stopped with {len(results.records)} of {len(plan.trials)} trials complete in "
            f"{folder}",
            stopping.signal,
        )
    if failed:
        raise RunError(
            f"{len(failed)} of {len(plan.trials)} trials failed; the first, {failed[0][0]}: "
            f"{failed[0][1]}\nThe others are kept in {folder}."
        )
    return Comparison(folder, results)


def _try_algorithms(plan: ComparisonPlan, bound: BoundTask) -> None:
    """Refuse before anything is run what cannot be run: settings, missing libraries.

    Raises:
        SerpError: An algorithm cannot be made.
    """
    for name, algorithm in plan.algorithms.items():
        trial = next(trial for trial in plan.trials if trial.algorithm == name)
        settings = plan.settings(trial)
        if algorithm.kind == "guest":
            make_contestant(algorithm, bound, settings, trial.seed)


def _run(
    plan: ComparisonPlan,
    missing: Sequence[Trial],
    processes: int,
    stopping: Stopping,
    *,
    quiet: bool,
) -> list[tuple[str, str]]:
    """Run trials until it is asked to stop; return what failed."""
    failed: list[tuple[str, str]] = []
    if not missing:
        return failed
    processes = min(processes, len(missing))
    jobs = [_job(plan, trial) for trial in missing]
    here = processes > 1 and not portable(jobs)
    processes = 1 if here else processes
    outlook = RemainingTime(missing, plan.conditions.env_steps, processes)
    with Display(outlook, len(missing), quiet=quiet) as display:
        if here:
            display.say(
                "The trials run one after another: the task has functions that cannot be imported "
                "from other processes (lambdas, or functions of a notebook or of __main__)."
            )

        def stopped() -> bool:
            return stopping.requested

        def notice(trial: Trial, env_steps: int) -> None:
            answer = stopping.answer(
                "the trials that run", "they are run again when the comparison goes on"
            )
            if answer is not None:
                display.say(answer)
            display.notice(trial, env_steps)

        if processes == 1:
            ends = run_here(jobs, notice, stopped)
        else:
            ends = run_in_processes(jobs, processes, notice, stopped)
        for ended in ends:
            display.end(ended.trial, ended.error)
            if ended.error is not None:
                failed.append((named_trial(ended.trial), ended.error))
        return failed


def _job(plan: ComparisonPlan, trial: Trial) -> Job:
    """Return what a worker needs for one trial."""
    algorithm: Algorithm = plan.algorithms[trial.algorithm]
    about = {
        "env_steps": plan.conditions.env_steps,
        "settings": settings_in_use(algorithm, plan.settings(trial)),
        "description": algorithm.description,
        "made_of": plan.made_of(trial),
    }
    task = plan.variants[trial.variant]
    return Job(plan.folder, trial, algorithm, task, plan.conditions, plan.changes, about)


def _about(plan: ComparisonPlan, bound: BoundTask, notes: Sequence[str]) -> ComparisonAbout:
    conditions = plan.conditions
    settings = resolve("default", bound.task.settings, plan.changes)
    return ComparisonAbout(
        task=plan.name,
        algorithms=list(plan.algorithms),
        variants={
            name: kept_file(plan.folder, name).relative_to(plan.folder).as_posix()
            for name in plan.variants
        },
        base=plan.base,
        trials=plan.trials,
        env_steps=conditions.env_steps,
        seeds=plan.seeds,
        threshold=plan.threshold,
        evaluate_every=conditions.evaluate_every,
        evaluation_episodes=conditions.evaluation_episodes,
        final_episodes=conditions.final_episodes,
        rewarded_by=reward_source(bound.rewarded_by, settings),
        inputs=_INPUTS[settings.training.inputs],
        command=command(plan),
        unit=unit_of(bound.task),
        notes=notes,
    )


_INPUTS = {
    "observation": "the observation",
    "state": "the grounded state",
    "both": "the observation and the grounded state",
}
