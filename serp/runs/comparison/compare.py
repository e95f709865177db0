"""`compare`: plans the trials, runs the missing ones, and writes the report."""

from __future__ import annotations

import contextlib
import dataclasses
import warnings
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from serp.agent.agent import Agent
from serp.agent.arbiter import Arbiter
from serp.errors import Interrupted, Notice, RunError, needs_extra
from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.planning.lookahead import Lookahead
from serp.runs.comparison.folder import merge_into, writing
from serp.runs.comparison.measures import Results
from serp.runs.comparison.plan import Record, Trial, read_plan, write_plan
from serp.runs.comparison.request import (
    ComparisonRequest,
    PreparedComparison,
    metadata_of,
    prepare,
    requested_task,
)
from serp.runs.comparison.tables import overview
from serp.runs.comparison.trial import make_contestant
from serp.runs.comparison.trial_files import is_complete, read_trial, write_trial
from serp.runs.comparison.workers import (
    ONE_AFTER_ANOTHER,
    Display,
    Ended,
    at_once,
    open_pool,
    run_here,
    run_in_executor,
    runs_here,
)
from serp.runs.folder import default_path
from serp.runs.train import Stopping, stop_between_episodes
from serp.settings import Settings, resolve
from serp.tasks.task import BoundTask, Task, reward_source

_STEPS: Final = 500
_SEED: Final = 0


def judges_alike(prepared: PreparedComparison, bound: BoundTask) -> list[str]:
    """Return a warning for each domain file that judges random steps differently from the base.

    If rewards of the domain file are learned from, learners with it are trained on another reward.
    """
    base, *others = prepared.plan.variants
    if not others:
        return []
    settings = resolve("default", bound.task.settings, prepared.plan.changes)
    with contextlib.ExitStack() as stack:
        files = {name: stack.enter_context(prepared.tasks[name].bind()) for name in others}
        return [
            f"The domain file `{name}` {what} other steps than `{base}` does: results "
            "on it cannot be compared."
            for name, what in _different(bound, files, settings).items()
        ]


def made_alike(records: Iterable[Record]) -> list[str]:
    """Return a warning if trials were made with different versions of a package."""
    found: dict[str, set[str]] = {}
    for record in records:
        for name, version in (record.metadata.get("versions") or {}).items():
            found.setdefault(name, set()).add(version or "not installed")
    differ = [
        f"{name} ({', '.join(sorted(several))})"
        for name, several in found.items()
        if len(several) > 1
    ]
    if not differ:
        return []
    return [
        f"The trials were made with different versions of {', '.join(differ)}: equal seeds need "
        "not give equal numbers."
    ]


def _different(
    bound: BoundTask, files: Mapping[str, BoundTask], settings: Settings
) -> dict[str, str]:
    """Return the files that differ from that of `bound`, with a word for the difference."""
    different: dict[str, str] = {}
    by_file = reward_source(bound.rewarded_by, settings) != "environment"
    random = np.random.default_rng(_SEED)
    arbiter = Arbiter(Lookahead(bound.model, settings.planner), bound.actions)
    everyone = {"": bound, **files}

    def grounded(
        raw: Any, info: Mapping[str, Any]
    ) -> dict[str, Vector]:  # the order of fluents may differ
        return {name: file.ground(raw, info, bound.env) for name, file in everyone.items()}

    states = grounded(*bound.reset(seed=_SEED))
    for step in range(_STEPS):
        action = int(random.integers(bound.actions.size))
        ground = int(arbiter.forecast(states[""]).ground[action])
        named = bound.model.actions[ground].name if ground >= 0 else None
        raw, _, terminated, truncated, info = bound.step(action)
        before, states = states, grounded(raw, info)
        expected = _judged(bound.model, before[""], named, states[""])
        for name in files:
            if expected is None:
                break
            found = _judged(files[name].model, before[name], named, states[name])
            if by_file and (found is None or found[0] != expected[0]):
                different.setdefault(name, "rewards")
            elif found is None or found[1] != expected[1]:
                different.setdefault(name, "flags unsafe")
        if terminated or truncated:
            states = grounded(*bound.reset(seed=_SEED + 1 + step))
    return different


def _judged(
    model: TransitionModel, before: Vector, action: str | None, after: Vector
) -> tuple[float, bool] | None:
    """Return reward and unsafety of a step by a domain file; None if it lacks the action."""
    try:
        judged = model.judge(before, -1 if action is None else model.action_index(action), after)
    except StateError:
        return None
    return judged.reward, judged.unsafe


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
        from serp.runs.comparison.report import write_report
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
