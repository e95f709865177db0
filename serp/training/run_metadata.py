"""The metadata of a run: its `config.json`, written and read."""

from __future__ import annotations

import datetime
import hashlib
import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    NonNegativeInt,
    ValidationError,
)

from serp._util.files import read_regular
from serp._util.numbers import COUNTED
from serp._util.saved_state import Saved
from serp.errors import RunError, SettingsError
from serp.model.loading import Domain, problem_beside
from serp.runs.checkpoint import Checkpoint
from serp.runs.config import CONFIG
from serp.runs.folder import RunFolder
from serp.settings import Settings
from serp.tasks.reward import reward_source
from serp.tasks.worlds.options import WorldOptions
from serp.training.budget import Budget

if TYPE_CHECKING:
    from serp.tasks.bound_task import BoundTask


class RunMetadata(BaseModel):
    """The part of a run's configuration that it is read back with."""

    model_config = ConfigDict(frozen=True, strict=True, use_attribute_docstrings=True)

    task: str
    """Name of the task."""
    seed: NonNegativeInt
    """Seed of everything random."""
    reward: Literal["domain", "environment"]
    """The source of the reward that the task declares."""
    control_period: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    """Seconds between two decisions."""
    settings: Annotated[Settings, BeforeValidator(Settings.from_dict)]
    """All settings."""
    budget: Annotated[Budget, BeforeValidator(Budget.from_dict)]
    """The budget that the run began with."""
    observed: list[str] | None = []
    """Fluents that the environment gives although the problem's `:init` states them. None: all
    states can be reached from there, see `Task.closed`."""
    planners: list[str] = []
    """Planners of the task that are domain files, in the order of their copies."""
    max_ground_schemas: Annotated[int, Field(ge=1, le=COUNTED)]
    """Limit on the size of each grounded domain."""
    world: Annotated[WorldOptions | None, BeforeValidator(WorldOptions.from_dict)] = None
    """What the environment was made with, if it was made of the file itself."""


def begin_run(
    path: Path,
    task: BoundTask,
    settings: Settings,
    *,
    preset: str,
    seed: int,
    budget: Budget,
    begun: datetime.datetime,
) -> RunFolder:
    """Begin a run in a new or empty folder, and lock it for writing."""
    planners = {n: d for n, d in task.task.planners.items() if isinstance(d, Domain)}
    config = {
        "task": task.name,
        "domain": task.domain.name,
        "observed": None if task.task.closed else sorted(task.domain.supplied or ()),
        "world": None if task.task.world is None else task.task.world.as_dict(),
        "max_ground_schemas": task.domain.max_ground_schemas,
        "preset": preset,
        "seed": seed,
        "reward": task.rewarded_by,
        "learned_from": reward_source(task.rewarded_by, settings),
        "file_rewards": task.model.rewarding,
        "control_period": task.model.dt,
        "planners": list(planners),
        "budget": budget.as_dict(),
        "settings": settings.as_dict(),
    }
    own, *others = (
        [(source.name, source.text) for source in domain.sources]
        for domain in (task.domain, *planners.values())
    )
    return RunFolder.create(path, config, own, planners=others, command=sys.argv, now=begun)


def read_run_metadata(folder: RunFolder) -> RunMetadata:
    """Read a run's configuration; raise `RunError` if a value is missing or wrong."""
    try:
        return RunMetadata.model_validate(folder.config)
    except (ValidationError, SettingsError) as error:
        what = str(error)
        if isinstance(error, ValidationError):
            first = error.errors(include_url=False)[0]
            what = f"{first['loc'][0]}: {first['msg']}"
        raise RunError(
            f"{folder.path / CONFIG} was changed or damaged: {what}; restore it from a copy"
        ) from error


def content_digests(folder: RunFolder) -> dict[str, str]:
    """Return digests of a run's domain files and of its configuration except the budget."""
    config = {name: value for name, value in folder.config.items() if name != "budget"}
    made = {CONFIG: json.dumps(config, sort_keys=True).encode()}
    for number in range(1 + len(read_run_metadata(folder).planners)):
        domain, problem = folder.copies(number)
        beside = problem_beside(domain)  # perhaps not written by serp, but it would be loaded
        for file in (domain, problem, beside):
            if file is not None and (file is not beside or os.path.lexists(file)):
                try:
                    made[file.name] = read_regular(file)
                except OSError as error:
                    raise RunError(f"cannot read {file}: {error.strerror or error}") from error
    return {name: hashlib.sha256(content).hexdigest() for name, content in made.items()}


def refuse_changes(folder: RunFolder, checkpoint: Checkpoint, *, domain_only: bool = False) -> None:
    """Check that the files of a run are those that a checkpoint of it began with.

    Raises:
        RunError: A domain file, or the configuration unless `domain_only`, was changed.
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
