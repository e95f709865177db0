"""What a run was made with, read back from its `config.json`."""

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
    """What a run was made with.

    Attributes:
        task: Name of the task.
        seed: Seed of everything random.
        reward: Whose reward the learner learns from.
        dt: Control period.
        settings: All settings.
        budget: How long it was to last.
        observed: Fluents that the environment gives although the problem's `:init` states them.
        max_ground_schemas: How large its domain may be.
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
    """Return digests of what a run is made of: its domain, its configuration but the budget."""
    config = {name: value for name, value in folder.config.items() if name != "budget"}
    made = {CONFIG: json.dumps(config, sort_keys=True).encode()}
    beside = problem_beside(folder.domain_file)  # none of its files, but one that would be loaded
    for file in (folder.domain_file, folder.problem_file, beside):
        if file is not None and (file is not beside or os.path.lexists(file)):
            try:
                made[file.name] = read_regular(file)
            except OSError as error:
                raise RunError(f"cannot read {file}: {error.strerror or error}") from error
    return {name: hashlib.sha256(content).hexdigest() for name, content in made.items()}


def refuse_changes(
    folder: RunFolder, checkpoint: Checkpoint, *, domain_alone: bool = False
) -> None:
    """Refuse to go on with other files than a run began with: it would be neither of two runs.

    Args:
        folder: The run.
        checkpoint: What was saved of it.
        domain_alone: Whether its configuration may be another one.

    Raises:
        RunError: A file was changed.
    """
    _, before = Saved("run", {}, checkpoint.meta).part("made_of")
    if not isinstance(before, dict):
        raise RunError(f"{checkpoint.path} does not say what its run was made of")
    now = content_digests(folder)
    for name in sorted((before.keys() | now.keys()) - ({CONFIG} if domain_alone else set())):
        if before.get(name) != now.get(name):
            raise RunError(
                f"{name} of the run was changed since it began, so that what was learned does not "
                "belong to it any more; undo the change, or begin a run of its own with it"
            )
