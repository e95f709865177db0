"""What a run was made with, read back from its `config.json`."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

from serp.errors import RunError, SettingsError
from serp.quantities import real, seed_of, whole
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
        episodes: Budget in episodes; None for none.
        env_steps: Budget in env steps; None for none.
    """

    task: str
    seed: int
    reward: Literal["domain", "environment"]
    dt: float
    settings: Settings
    episodes: int | None
    env_steps: int | None


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
            episodes=_count(config["budget"]["episodes"]),
            env_steps=_count(config["budget"]["env_steps"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError, SettingsError) as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise RunError(
            f"{folder.path / CONFIG} was changed or damaged: {what}; restore it from a copy"
        ) from error


def _count(value: Any) -> int | None:
    count = None if value is None else whole(value, 1)
    if count is None and value is not None:
        raise ValueError(f"a budget is {value!r}")
    return count
