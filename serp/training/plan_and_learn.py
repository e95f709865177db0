"""`plan_and_learn`: trains into a run folder, or continues a run.

What the user gave is checked before torch is imported and anything is compiled.
"""

from __future__ import annotations

import datetime
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from serp._util.numbers import seed_of
from serp.control.registry import refuse_unknown_names
from serp.errors import RunError, SettingsError, TaskError
from serp.runs.folder import RunFolder, is_trace
from serp.runs.new_folder import default_path, refuse_occupied
from serp.runs.tensorboard import require_tensorboard
from serp.settings import resolve
from serp.tasks.registry import find_task
from serp.tasks.task import Task
from serp.training.budget import Budget
from serp.training.callbacks import Callbacks, TrainingCallbacks
from serp.training.run_metadata import begin_run

if TYPE_CHECKING:
    from serp.training.run import Run


def plan_and_learn(
    task: Task | str,
    *,
    preset: str = "default",
    settings: Mapping[str, Mapping[str, Any]] | None = None,
    episodes: int | None = None,
    env_steps: int | None = None,
    seed: int = 0,
    out: str | Path | None = None,
    resume: bool = False,
    quiet: bool = False,
    **callbacks: Unpack[TrainingCallbacks],
) -> Run:
    """Train on a task: the planner acts from the first step, the learner takes over.

    Args:
        task: The task, the name of an installed one, or a domain file that belongs to one.
        preset: `default` or `paper`.
        settings: Section → setting → value; overrides preset and task; see `serp.Settings`.
        episodes: Number of episodes since the run began after which it ends.
        env_steps: Number of env steps since the run began after which it ends; the episode that
            reaches it is finished. With neither, a resumed run continues to its own budget, and a
            new run ends after `training.units` or `training.env_steps` of the settings.
        seed: Seed of everything random.
        out: Folder of the run; by default `runs/<domain>-<time>`.
        resume: Continue the run in `out` with its own domain, settings and seed; the continued
            run equals one that was never interrupted.
        quiet: Show no progress.
        **callbacks: `on_step`, a function that is called with the `serp.StepRecord` of every env
            step, and `on_episode`, one that is called with the metrics of every episode
            (`MetricsRow`). They must not change what they get. If one of them raises, the episode
            is finished, the run is saved, and the error is raised.

    Returns:
        The finished run.

    Raises:
        SerpError: Domain, task, settings or folder are wrong, or the environment failed.
        Interrupted: Ctrl-C, SIGTERM or SIGHUP; the run is saved and can be resumed.
    """
    begun = datetime.datetime.now()
    budget = Budget(episodes=episodes, env_steps=env_steps)
    called = Callbacks(callbacks)
    seed = seed_of(seed)
    if not isinstance(out, str | os.PathLike | None) or "\0" in str(out):
        raise SettingsError(f"out must be the name of a folder, not {out!r}")
    if not isinstance(task, Task | str):
        raise TaskError(f"a task is a serp.Task, a name or a domain file, not {task!r}")
    if resume:
        if out is None:
            raise RunError("to resume, name the run's folder (--out RUN)")
        folder = RunFolder.open(out, writing=True)
        with folder:
            from serp.training.run import task_of_run
            from serp.training.saved_training import continue_training

            # The run has its own copy of the domain.
            own = task_of_run(folder, None if isinstance(task, str) else task)
            with own.bind() as bound:
                return continue_training(folder, bound, budget, called, quiet=quiet)
    if isinstance(task, str):
        task = find_task(task)
    resolved = resolve(preset, task.settings, settings)
    refuse_unknown_names(resolved, task.planners)
    if resolved.training.tensorboard:
        require_tensorboard()
    if out is not None:
        refuse_occupied(Path(out), is_trace)
    with task.bind() as bound:
        path = Path(out) if out is not None else default_path(bound.name, begun)
        from serp.training.saved_training import compiled_trainer, train

        with (
            compiled_trainer(bound, resolved, seed, quiet=quiet) as trainer,
            begin_run(
                path, bound, resolved, preset=preset, seed=seed, budget=budget, begun=begun
            ) as folder,
        ):
            return train(folder, trainer, budget, called, quiet=quiet)
