"""How long a training lasts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Protocol

from serp._util.numbers import whole
from serp.errors import SettingsError


class Counted(Protocol):
    """What counts episodes, env steps and units; `Trainer` does."""

    episode: int
    env_steps: int
    units: int


@dataclass(frozen=True)
class Budget:
    """A training ends as soon as one of these is reached, counted from the run's beginning.

    Attributes:
        episodes: Episodes that have ended; None for no such end.
        env_steps: Env steps; the episode that reaches the number is finished.
        units: Units of `arbiter.rho_unit` that have ended, such as games.

    Raises:
        SettingsError: One of them is no whole number from 1 on.
    """

    episodes: int | None = None
    env_steps: int | None = None
    units: int | None = None

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if value is None:
                continue
            number = whole(value, 1)
            if number is None:
                raise SettingsError(f"{name} must be a whole number, at least 1, not {value!r}")
            object.__setattr__(self, name, number)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Budget:
        """Return the budget that `as_dict` wrote.

        Raises:
            SettingsError: It is none.
        """
        try:
            return cls(**{name: values[name] for name in ("episodes", "env_steps", "units")})
        except (KeyError, TypeError):
            raise SettingsError(f"{values!r} is no budget") from None

    def as_dict(self) -> dict[str, int | None]:
        """Return JSON values."""
        return asdict(self)

    @property
    def given(self) -> bool:
        """Whether there is any end."""
        return any(value is not None for value in asdict(self).values())

    def spent_by(self, counted: Counted) -> bool:
        """Return whether an end is reached."""
        pairs = (
            (counted.episode, self.episodes),
            (counted.env_steps, self.env_steps),
            (counted.units, self.units),
        )
        return any(end is not None and now >= end for now, end in pairs)
