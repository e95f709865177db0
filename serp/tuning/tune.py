"""`tune`: searches settings with Optuna, by the returns of whole trainings.

A trial of the study trains with several seeds; its value is the mean over them. The search is
Optuna's tree-structured Parzen estimator (Bergstra et al. 2011).
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from serp._util.number_format import readable
from serp._util.terminal import open_console
from serp.comparison.engines import ONE_AFTER_ANOTHER, at_once, open_pool, runs_here
from serp.errors import Interrupted, RunError, SettingsError, TaskError, needs_extra
from serp.runs.new_folder import default_path
from serp.settings import Changes
from serp.tasks.registry import find_task
from serp.tasks.task import Task
from serp.training.stopping import stop_between_episodes
from serp.tuning.request import TuningRequest
from serp.tuning.search import Search
from serp.tuning.space import changes_of
from serp.tuning.study import Study, open_study


@dataclass(frozen=True)
class Tuned:
    """The result of a study.

    Attributes:
        settings: The best settings that were found: section → setting → value.
        value: Their objective, the mean over the seeds.
        before: The objective of the settings as they were; None if these are outside of the space.
        trials: Number of trials that came to an end.
        study: The study, an `optuna.Study`.
        storage: URL of its storage.
    """

    settings: Changes
    value: float
    before: float | None
    trials: int
    study: Any
    storage: str


def tune(task: Task | str, **options: Any) -> Tuned:
    """Search settings on a task; needs the extra `tune`.

    The first trial has the settings as they are. A call with the same storage goes on until the
    study has `trials` in all; several processes may work on one study.

    Args:
        task: The task, the name of an installed one, or a domain file; one that belongs to no
            installed task is a world, as `serp.file_task` makes it.
        **options: All but `vary` are optional.

            * `vary`: name of a setting (`learner.learning_rate`) → its values: a text (`A..B`,
              `log:A..B` or `A,B,...`), a list, or None for all values of a truth value or word.
            * `algorithm`: one of serp's algorithms; `serp` by default.
            * `objective`: `training`, the area under the training curve (the default), or
              `evaluation`, the mean return of the trained policy.
            * `trials`: number of trials; 50 by default.
            * `seeds`: how many seeds, from 1,000 on, or a list of seeds; 3 by default. Results are
              to be reported with other seeds.
            * `env_steps`: budget of each training; by default `training.env_steps` of the task.
            * `settings`: section → setting → value, for all trials.
            * `storage`: a file, or the URL of a database; by default
              `runs/tune-<domain>-<time>.db`.
            * `study`: name of the study in it; that of the task by default.
            * `prune`: end a trial after a seed if its mean so far is below the median of others.
            * `seed`: seed of the search.
            * `engine`, `address`, `jobs`: what runs the trainings, as in `serp.compare`.
            * `quiet`: show no progress.

    Raises:
        SerpError: Task, options, settings or storage are wrong, or no trial succeeded.
        Interrupted: Ctrl-C, SIGTERM or SIGHUP; the study can be continued.
    """
    if "vary" not in options:
        raise SettingsError("tune: say what to `vary`, such as {'planner.depth': '2..7'}")
    request = TuningRequest(**options)
    with needs_extra("tune", "tuning"):
        import optuna
    if not isinstance(task, Task | str):
        raise TaskError(f"a task is a serp.Task, a name or a domain file, not {task!r}")
    search = Search(find_task(task, worlds=True) if isinstance(task, str) else task, request)
    jobs = search.jobs({})
    most = at_once(request.engine, request.jobs, len(jobs))
    here = runs_here(request.engine, jobs, most)
    storage = request.storage or f"sqlite:///{default_path(f'tune-{search.name}')}.db"
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    found = open_study(optuna, storage, request.study or search.name, search.digest)
    console = open_console(stderr=True)

    def say(text: str) -> None:
        if not request.quiet:
            console.print(text, soft_wrap=True)

    if here and most != 1:
        say(ONE_AFTER_ANOTHER)
    with ExitStack() as stack, stop_between_episodes() as stopping:
        pool = None
        if not here:
            pool = stack.enter_context(open_pool(request.engine, request.address, most))

        def stopped() -> bool:
            answer = stopping.answer("the trainings that run", "this trial is lost")
            if answer is not None:
                say(answer)
            return stopping.requested

        study = Study(optuna, found, search, pool, stopped)
        while (done := study.finished) < request.trials and not stopped():
            told = study.run_trial()
            if told is not None:
                say(f"[{done + 1}/{request.trials}] {told}")
    if stopping.signal is not None and done < request.trials:
        raise Interrupted(
            f"stopped after {done} of {request.trials} trials, which are in {storage}",
            stopping.signal,
        )
    best = study.best()
    if best is None:
        raise RunError(
            f"none of {done} trials succeeded; the first failed: {study.first_failure()}"
        )
    say(f"best: {readable(best[1])}")
    return Tuned(changes_of(best[0]), best[1], study.before(), done, found, storage)
