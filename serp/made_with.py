"""What a run was made with, read back from its `config.json`."""

from __future__ import annotations

from typing import Literal, NamedTuple

from serp.budget import Budget
from serp.errors import RunError, SettingsError
from serp.quantities import real, seed_of
from serp.runs.config import CONFIG
from serp.runs.folder import RunFolder
from serp.settings import Settings


class MadeWith(NamedTuple):
    """What a run was made with.

    Attributes:
        task: Name of the task.
        seed: Seed of everything random.
        reward: Whose reward the learner learns from.
        dt: Control period.
        settings: All settings.
        budget: How long it was to last.
    """

    task: str
    seed: int
    reward: Literal["domain", "environment"]
    dt: float
    settings: Settings
    budget: Budget


def made_with(folder: RunFolder) -> MadeWith:
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
        return MadeWith(
            task=str(config["task"]),
            seed=seed_of(config["seed"]),
            reward=config["reward"],
            dt=dt,
            settings=Settings.from_dict(config["settings"]),
            budget=Budget.from_dict(config["budget"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError, SettingsError) as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise RunError(
            f"{folder.path / CONFIG} was changed or damaged: {what}; restore it from a copy"
        ) from error
