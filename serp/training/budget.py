"""The budget of a training."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Protocol

from pydantic import Field

from serp.errors import SettingsError
from serp.settings.section import Section

Limit = Annotated[int, Field(ge=1)] | None


class Counted(Protocol):
    """An object with counts of episodes, env steps and units, such as a `Trainer`."""

    episode: int
    env_steps: int
    units: int


class Budget(Section):
    """Limits of a training, counted from the run's beginning; it ends when it reaches one."""

    episodes: Limit = None
    """Number of complete episodes; None for no limit."""
    env_steps: Limit = None
    """Number of env steps; the episode that reaches it is finished. None for no limit."""
    units: Limit = None
    """Number of complete units of `arbiter.rho_unit`, such as games; None for no limit."""

    @classmethod
    def from_dict(cls, values: Any) -> Budget:
        """Return the budget that `as_dict` wrote.

        Raises:
            SettingsError: It is not a budget.
        """
        if not isinstance(values, Mapping):
            raise SettingsError(f"{values!r} is not a budget")
        return cls(**values)

    @property
    def limits(self) -> dict[str, int]:
        """The limits that there are, by name."""
        return {name: limit for name, limit in self if limit is not None}

    @staticmethod
    def counts(counted: Counted) -> dict[str, int]:
        """Return the counts by the names of their limits."""
        return {
            "episodes": counted.episode,
            "env_steps": counted.env_steps,
            "units": counted.units,
        }

    def spent_by(self, counted: Counted) -> bool:
        """Return whether a limit is reached."""
        counts = self.counts(counted)
        return any(counts[name] >= limit for name, limit in self.limits.items())
