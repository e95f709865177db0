"""The budget of a training."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Protocol

from pydantic import Field

from serp.errors import SettingsError
from serp.settings.section import Section

End = Annotated[int, Field(ge=1)] | None


class Counted(Protocol):
    """An object with counts of episodes, env steps and units, such as a `Trainer`."""

    episode: int
    env_steps: int
    units: int


class Budget(Section):
    """Limits of a training, counted from the run's beginning; it ends when it reaches one."""

    episodes: End = None
    """Number of complete episodes; None for no limit."""
    env_steps: End = None
    """Number of env steps; the episode that reaches it is finished. None for no limit."""
    units: End = None
    """Number of complete units of `arbiter.rho_unit`, such as games; None for no limit."""

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Budget:
        """Return the budget that `as_dict` wrote.

        Raises:
            SettingsError: It is not a budget.
        """
        if not isinstance(values, Mapping) or values.keys() != cls.model_fields.keys():
            raise SettingsError(f"{values!r} is not a budget")
        return cls(**values)

    @property
    def given(self) -> bool:
        """Whether there is any limit."""
        return any(end is not None for _, end in self)

    def spent_by(self, counted: Counted) -> bool:
        """Return whether a limit is reached."""
        pairs = (
            (counted.episode, self.episodes),
            (counted.env_steps, self.env_steps),
            (counted.units, self.units),
        )
        return any(end is not None and now >= end for now, end in pairs)
