"""How long a training lasts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Protocol

from pydantic import Field

from serp.errors import SettingsError
from serp.settings.base import Section

End = Annotated[int, Field(ge=1)] | None


class Counted(Protocol):
    """What counts episodes, env steps and units; `Trainer` does."""

    episode: int
    env_steps: int
    units: int


class Budget(Section):
    """A training ends as soon as one of these is reached, counted from the run's beginning."""

    episodes: End = None
    """Episodes that have ended; None for no such end."""
    env_steps: End = None
    """Env steps; the episode that reaches the number is finished."""
    units: End = None
    """Units of `arbiter.rho_unit` that have ended, such as games."""

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
        """Whether there is any end."""
        return any(end is not None for _, end in self)

    def spent_by(self, counted: Counted) -> bool:
        """Return whether an end is reached."""
        pairs = (
            (counted.episode, self.episodes),
            (counted.env_steps, self.env_steps),
            (counted.units, self.units),
        )
        return any(end is not None and now >= end for now, end in pairs)
