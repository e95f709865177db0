"""The metadata of a run, read from its `config.json`."""

from __future__ import annotations

import hashlib
import json
import os
from typing import Literal, NamedTuple

from serp._util.files import read_regular
from serp._util.numbers import COUNTED, real, seed_of, whole
from serp._util.saved_state import Saved
from serp.errors import RunError, SettingsError
from serp.model.loading import problem_beside
from serp.runs.checkpoint import Checkpoint
from serp.runs.config import CONFIG
from serp.runs.folder import RunFolder
from serp.settings import Settings
from serp.training.budget import Budget


class RunMetadata(NamedTuple):
    """The configuration of a run.

    Attributes:
        task: Name of the task.
        seed: Seed of everything random.
        reward: The source of the reward that the task declares.
        dt: Control period.
        settings: All settings.
        budget: The budget that the run began with.
        observed: Fluents that the environment gives although the problem's `:init` states them.
        max_ground_schemas: Limit on the size of the grounded domain.
    """

    task: str
    seed: int
    reward: Literal["domain", "environment"]
    dt: float
    settings: Settings
    budget: Budget
    observed: tuple[str, ...]
    max_ground_schemas: int


def read_run_metadata(folder: RunFolder) -> RunMetadata:
    """Read a run's configuration.

    Raises:
        RunError: Something is missing in it, or of the wrong kind.
    """
    config = folder.config
    try:
        if config["reward"] not in ("domain", "environment"):
            raise ValueError(f"reward is {config['reward']!r}")
        dt = real(config["control_period"])
        if dt is None or dt <= 0:
            raise ValueError(f"control_period is {config['control_period']!r}")
        limit = whole(config["max_ground_schemas"], 1, COUNTED)
        if limit is None:
            raise ValueError(f"max_ground_schemas is {config['max_ground_schemas']!r}")
        return RunMetadata(
            task=str(config["task"]),
            seed=seed_of(config["seed"]),
            reward=config["reward"],
            dt=dt,
            settings=Settings.from_dict(config["settings"]),
            budget=Budget.from_dict(config["budget"]),
            observed=tuple(map(str, config.get("observed", ()))),
            max_ground_schemas=limit,
        )
    except (KeyError, TypeError, ValueError, AttributeError, SettingsError) as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise RunError(
            f"{folder.path / CONFIG} was changed or damaged: {what}; restore it from a copy"
        ) from error


def content_digests(folder: RunFolder) -> dict[str, str]:
    """Return digests of a run's domain files and of its configuration except the budget."""
    config = {name: value for name, value in folder.config.items() if name != "budget"}
    made = {CONFIG: json.dumps(config, sort_keys=True).encode()}
    beside = problem_beside(folder.domain_file)  # not written by serp, but it would be loaded
    for file in (folder.domain_file, folder.problem_file, beside):
        if file is not None and (file is not beside or os.path.lexists(file)):
            try:
                made[file.name] = read_regular(file)
            except OSError as error:
                raise RunError(f"cannot read {file}: {error.strerror or error}") from error
    return {name: hashlib.sha256(content).hexdigest() for name, content in made.items()}


def refuse_changes(folder: RunFolder, checkpoint: Checkpoint, *, domain_only: bool = False) -> None:
    """Check that the files of a run are those that it began with.

    Args:
        folder: The run.
        checkpoint: A checkpoint of it.
        domain_only: Whether to check only the domain files, not the configuration.

    Raises:
        RunError: A file was changed.
    """
    _, before = Saved("run", {}, checkpoint.meta).part("made_of")
    if not isinstance(before, dict):
        raise RunError(f"{checkpoint.path} holds no digests of the run's files")
    now = content_digests(folder)
    for name in sorted((before.keys() | now.keys()) - ({CONFIG} if domain_only else set())):
        if before.get(name) != now.get(name):
            raise RunError(
                f"{name} of the run was changed since it began, so that it does not fit what was "
                "learned; undo the change, or begin a new run with it"
            )
