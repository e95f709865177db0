"""The configuration of a run, ``config.json``: declared once, written and read back with it."""

from __future__ import annotations

import contextlib
import datetime
import functools
import importlib.metadata
import os
import platform
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, NonNegativeInt, ValidationError

from serp._util.did_you_mean import listed
from serp._util.files import json_text, read_json, write_durably
from serp._util.numbers import COUNTED
from serp.errors import RunError, SettingsError
from serp.settings import Section, Settings, first_of
from serp.tasks.file_world import WorldOptions

if TYPE_CHECKING:
    from serp.runs.trainer import Trainer

FORMAT: Final = 6
"""Raised where a run of before cannot be read any more."""
CONFIG: Final = "config.json"

Limit = Annotated[int, Field(ge=1)] | None


class Budget(Section):
    """Limits of a training, counted from the run's beginning; it ends when it reaches one."""

    episodes: Limit = None
    """Number of complete episodes; None for no limit."""
    env_steps: Limit = None
    """Number of env steps; the episode that reaches it is finished. None for no limit."""

    @property
    def limits(self) -> dict[str, int]:
        """The limits that there are, by name."""
        return {name: limit for name, limit in self if limit is not None}

    @staticmethod
    def counts(trainer: Trainer) -> dict[str, int]:
        """Return the counts of a training by the names of their limits."""
        return {"episodes": trainer.episode, "env_steps": trainer.env_steps}

    def spent_by(self, trainer: Trainer) -> bool:
        """Return whether a limit is reached."""
        counts = self.counts(trainer)
        return any(counts[name] >= limit for name, limit in self.limits.items())


class RunConfig(BaseModel):
    """What a training is made of."""

    model_config = ConfigDict(frozen=True, strict=True)

    task: str
    """Name of the task."""
    domain: str
    """Name of its domain."""
    observed: list[str] | None = []
    """Fluents that the environment gives although the problem's `:init` states them. None: all
    states can be reached from there, see `Task.closed`."""
    world: WorldOptions | None = None
    """What the environment was made with, if it was made of the file itself."""
    code: str = ""
    """Where the task is defined, see `Task.code`."""
    max_ground_schemas: Annotated[int, Field(ge=1, le=COUNTED)]
    """Limit on the size of each grounded domain."""
    preset: str
    """The preset that the settings began with."""
    seed: NonNegativeInt
    """Seed of everything random."""
    baseline: bool = False
    """Whether the learner always acts and nothing is refused, see `serp.agent.agent.Agent`."""
    reward: Literal["domain", "environment"]
    """The source of the reward that the task declares."""
    learned_from: Literal["domain", "environment", "sum"]
    """The source of the reward that the learner used."""
    file_rewards: bool
    """Whether the domain file gives rewards."""
    control_period: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    """Seconds between two decisions."""
    budget: Budget
    """The budget that the run began with."""
    settings: Settings
    """All settings."""


class _Metadata(BaseModel):
    """What every ``config.json`` holds, and more."""

    model_config = ConfigDict(strict=True)

    created: str
    command: list[str]
    domain_files: dict[str, str]
    config: RunConfig
    versions: dict[str, Any]
    machine: dict[str, Any]


def write_metadata(folder: Path, config: RunConfig, domain_files: Mapping[str, str]) -> None:
    """Write the ``config.json`` of a run that begins, on this machine by this command.

    `domain_files` are the name of each copy in the run → name of the original file.
    """
    metadata = {
        "format": FORMAT,
        "created": datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
        "command": sys.argv,
        "seed": config.seed,
        "domain_files": dict(domain_files),
        "config": config.model_dump(mode="json"),
        "versions": versions(),
        "machine": machine(),
    }
    write_durably(folder / CONFIG, json_text(metadata))


def read_metadata(folder: Path) -> tuple[dict[str, Any], RunConfig]:
    """Read the ``config.json`` of a run: what `write_metadata` wrote, the configuration checked.

    Raises:
        RunError: There is none, or a value is missing or wrong.
    """
    if os.path.isfile(folder):
        raise RunError(f"{folder} is a file; give the folder of a run.")
    within = folder if os.path.isdir(folder) else folder.parent
    runs = sorted(str(each.parent) for each in within.glob(f"*/{CONFIG}"))
    there = f" Existing runs: {listed(runs)}." if runs else " serp plan-and-learn writes one."
    if within != folder:
        raise RunError(f"there is no run {folder}.{there}")
    file = folder / CONFIG
    if not os.path.isfile(file):
        raise RunError(f"{folder} is not a run: it has no {CONFIG}.{there}")
    about = read_json(file, "Restore it from a copy.")
    version = about.get("format")
    if version != FORMAT:
        versions = about.get("versions")
        wrote = versions.get("serp") if isinstance(versions, dict) else None
        raise RunError(
            f"{file} was written by another version of serp ({wrote or 'unknown'}): it has format "
            f"{version!r}, this version reads format {FORMAT}. Use that version, or train again."
        )
    try:
        return about, _Metadata.model_validate(about).config
    except (ValidationError, SettingsError) as error:
        raise RunError(
            f"{file} was not written by serp, or is damaged: {first_of(error)}. Restore it from a "
            "copy."
        ) from None


_PACKAGES: Final = (
    "serp", "numpy", "torch", "gymnasium", "scipy", "unified-planning", "networkx", "pymunk",
    "safetensors", "stable-baselines3",
)  # fmt: skip


@functools.cache
def versions() -> Mapping[str, str | None]:
    """Return distribution → installed version (None if not installed), without importing any."""
    found: dict[str, str | None] = dict.fromkeys(_PACKAGES)
    for name in _PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found


def machine() -> dict[str, Any]:
    """Return Python version, operating system, kind of processor and number of cores."""
    return {
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "platform": platform.platform(),
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
    }
