"""`tune`: searches settings with Optuna, by the returns of whole trainings.

A trial of the study trains with several seeds; its value is the mean over them. Each training is a
run folder in `trials/`, and the study is Optuna's journal beside it, `study.log`. The search is
Optuna's tree-structured Parzen estimator (Bergstra et al. 2011).
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import NonNegativeInt, PositiveInt

from serp._util.files import json_text
from serp._util.text import measured
from serp.errors import Interrupted, RunError, SettingsError, needs_extra
from serp.runs.comparison.algorithms import find_algorithm
from serp.runs.comparison.compare import locked
from serp.runs.comparison.pool import LOCAL, TrialsRequest, progress, run_jobs
from serp.runs.comparison.statistics import measure
from serp.runs.comparison.trial import Job, TrialProtocol, read_trial
from serp.runs.folder import default_path
from serp.runs.train import stop_between_episodes
from serp.settings import Changes
from serp.tasks.registry import find_task
from serp.tasks.task import Task


class TuneSettings(TrialsRequest):
    """The options of `serp.tune`, which describes them; None stands for the default."""

    first_seed: ClassVar[int] = 1_000  # seeds from 0 on are for the results that are reported
    seeds: tuple[NonNegativeInt, ...] = tuple(range(first_seed, first_seed + 3))
    vary: Mapping[str, Any]
    algorithm: str = "serp"
    objective: Literal["training", "evaluation"] = "training"
    trials: PositiveInt = 50
    env_steps: PositiveInt | None = None
    seed: NonNegativeInt = 0


@dataclass(frozen=True)
class Tuned:
    """The result of a study.

    Attributes:
        settings: The best settings that were found: section → setting → value.
        value: Their objective, the mean over the seeds.
        before: The objective of the settings as they were; None if these are outside of the space.
        gain: The difference of the two, paired by seed: its mean and its standard error. The best
            of many trials is selected, so its mean is biased upwards. None without `before`.
        trials: Number of trials that came to an end.
        study, path: The `optuna.Study`, and its folder.
    """

    settings: Changes
    value: float
    before: float | None
    gain: tuple[float, float] | None
    trials: int
    study: Any
    path: Path


class _Search:
    """What the trials of a study are."""

    def __init__(self, task: Task, request: TuneSettings) -> None:
        from serp.runs.tuning_space import parameters_of, space_of

        self.request, self.space = request, space_of(request.vary)
        self._algorithm = algorithm = find_algorithm(request.algorithm)
        if algorithm.kind == "external":
            raise SettingsError(f"`{algorithm.name}` has no settings that serp could tune")
        with task.bind() as bound:  # checks the task
            self.name, self._task = bound.name, bound.task.loaded()
        settings = algorithm.settings(task, request.settings)
        self.env_steps = steps = request.env_steps or settings.training.env_steps
        evaluated = request.objective == "evaluation"
        self._measure = "final_policy" if evaluated else "training_area"
        self._protocol = TrialProtocol(
            env_steps=steps, evaluate_every=steps, final_episodes=50 if evaluated else 1
        )
        self.own = parameters_of(self.space, settings)
        """The settings as they are, in Optuna's form; empty if one is not in the space."""
        parts = (
            self.name, [source.text for source in self._task.load().sources], settings.as_dict(),
            self._protocol.model_dump(), request.objective, request.seeds, request.seed,
            sorted(map(str, self.space.items())),
        )  # fmt: skip
        self.digest = hashlib.sha256(json_text(parts).encode()).hexdigest()

    def jobs(self, folder: Path, number: int, parameters: Mapping[str, Any]) -> list[Job]:
        """Return the trainings of a trial, one for each seed."""
        from serp.runs.tuning_space import changes_of

        algorithm = self._algorithm.changed(self._algorithm.name, changes_of(parameters))
        settings = algorithm.settings(self._task, self.request.settings)
        return [
            Job(
                algorithm, seed, self._task, settings, self._protocol,
                folder.absolute() / "trials" / f"{number}-{seed}",
            )
            for seed in self.request.seeds
        ]  # fmt: skip

    def values(self, jobs: list[Job]) -> list[float]:
        """Return what complete trainings are worth; NaN for one in which no episode ended."""
        trials = map(read_trial, jobs)
        return [float(measure(each, self.env_steps, None)[self._measure]) for each in trials]


def tune(task: Task | str, **options: Any) -> Tuned:
    """Search settings on a task; needs the extra `tune`.

    The first trial has the settings as they are. A call with the same `out` goes on until the study
    has `trials` in all; trainings that were interrupted go on from their last checkpoint.

    Args:
        task: The task, the name of an installed one, or a domain file; one that belongs to no
            installed task is a world, as `serp.file_task` makes it.
        **options: All but `vary` are optional.

            * `vary`: name of a setting (`learner.learning_rate`) → its values: a text (`A..B`,
              `log:A..B` or `A,B,...`) or a list.
            * `algorithm`: one of serp's algorithms; `serp` by default.
            * `objective`: `training`, the area under the training curve (the default), or
              `evaluation`, the mean return of the trained policy.
            * `trials`: number of trials; 50 by default.
            * `seeds`: how many seeds, from 1,000 on, or a list of seeds; 3 by default. Results are
              to be reported with other seeds.
            * `env_steps`: budget of each training; by default `training.env_steps` of the task.
            * `settings`: section → setting → value, for all trials.
            * `out`: folder of the study; by default `runs/tune-<domain>-<time>`.
            * `seed`: seed of the search.
            * `engine`, `address`, `jobs`, `quiet`: as in `serp.compare`. Where more trainings run
              at the same time than there are seeds, several trials do.

    Raises:
        SerpError: Task, options, settings or folder are wrong, or no trial succeeded.
        Interrupted: Ctrl-C, SIGTERM or SIGHUP; the study can be continued.
    """
    journal = "study.log"
    asked = "serp"
    with needs_extra("tune", "tuning"):
        import optuna
    from serp.runs.tuning_space import changes_of

    if "vary" not in options:
        raise SettingsError("tune: give the settings to `vary`, such as {'planner.depth': '2..7'}")
    request = TuneSettings(**options)
    search = _Search(find_task(task), request)
    folder = request.out or default_path(f"tune-{search.name}")
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    with locked(folder, journal):
        storage = optuna.storages.journal.JournalFileBackend(str(folder / journal))
        study = optuna.create_study(
            study_name=search.name, storage=optuna.storages.JournalStorage(storage),
            direction="maximize", load_if_exists=True,
        )  # fmt: skip
        if not study.user_attrs:
            study.set_user_attr(asked, search.digest)
        if study.user_attrs.get(asked) != search.digest:
            raise RunError(
                f"{folder} holds a study of another task, or with other settings, values, seeds or "
                "budget. Give another folder (--out)."
            )
        stopped = _run(optuna, study, search, folder)
    ended = [trial for trial in study.trials if trial.state.is_finished()]
    if stopped is not None and len(ended) < request.trials:
        raise Interrupted(
            f"stopped after {len(ended)} of {request.trials} trials, which are in {folder}.\n"
            f"Continue with the same command and --out {folder}.",
            stopped,
        )
    complete = [trial for trial in ended if trial.value is not None]
    if not complete:
        why = study.user_attrs.get(f"error {ended[0].number}")
        raise RunError(f"none of {len(ended)} trials succeeded; the first failed: {why}")
    best = max(complete, key=lambda trial: trial.value)
    own = next((trial for trial in complete if trial.params == search.own), None)
    before, gain = None, None
    if own is not None:
        before = own.value
        values, own_values = (study.user_attrs[f"values {t.number}"] for t in (best, own))
        gain = _mean_and_error(np.subtract(values, own_values))
    return Tuned(changes_of(best.params), best.value, before, gain, len(ended), study, folder)


def _mean_and_error(values: ArrayLike) -> tuple[float, float]:
    """Return the mean of values ``[n]`` and its standard error; NaN for a single one."""
    array = np.asarray(values, dtype=np.float64)
    error = array.std(ddof=1) / np.sqrt(len(array)) if len(array) > 1 else np.nan
    return float(array.mean()), float(error)


def _run(optuna: Any, study: Any, search: _Search, folder: Path) -> int | None:
    """Run trials until there are enough; return the number of the signal that stopped it, if any.

    As many trials are asked for at once as fill the workers. What is suggested depends on nothing
    but the results before, so that a study which was interrupted goes on as it would have.
    """
    request, state = search.request, optuna.trial.TrialState
    cores = os.cpu_count() or 1 if request.engine == LOCAL else len(request.seeds)
    at_once = max(1, (request.jobs or cores) // len(request.seeds))
    with stop_between_episodes() as stopping, progress("tuning", request.quiet) as say:
        while not stopping.requested:
            ended = sum(trial.state.is_finished() for trial in study.trials)
            running = {t.number: t.params for t in study.get_trials(states=[state.RUNNING])}
            if not running:
                for number in range(ended, min(ended + at_once, request.trials)):
                    study.sampler = optuna.samplers.TPESampler(seed=request.seed + number)
                    if number == 0 and search.own:
                        study.enqueue_trial(search.own)
                    trial = study.ask(search.space)
                    running[trial.number] = trial.params
            if not running:
                break
            jobs: dict[int, list[Job]] = {}
            errors: dict[int, str] = {}
            for number, parameters in running.items():
                try:
                    jobs[number] = search.jobs(folder, number, parameters)
                except SettingsError as error:
                    errors[number] = str(error)
            missing = [job for several in jobs.values() for job in several if not job.complete]
            for result in run_jobs(missing, request, stopping, say):
                if result.error is not None:
                    number = int(result.job.folder.name.partition("-")[0])
                    errors[number] = f"seed {result.job.seed}: {result.error}"
            for number, parameters in running.items():
                text = None
                if number not in errors and all(job.complete for job in jobs[number]):
                    values = search.values(jobs[number])
                    if np.all(np.isfinite(values)):
                        study.set_user_attr(f"values {number}", values)
                        study.tell(number, float(np.mean(values)))
                        text = measured(*_mean_and_error(values))
                    else:
                        errors[number] = (
                            f"no episode ended within {search.env_steps} env steps, so nothing was "
                            "measured; give a larger --env-steps"
                        )
                if number in errors:
                    study.set_user_attr(f"error {number}", errors[number])
                    study.tell(number, state=state.FAIL)
                    text = f"failed. {errors[number]}"
                if text is not None:
                    ended += 1
                    shown = ", ".join(f"{name}={value}" for name, value in parameters.items())
                    say(f"[{ended}/{request.trials}] {shown}: {text}")
    return stopping.signal
