"""What a world made of a file has beside the file: its disturbances and its time limit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from serp._util.numbers import COUNTED
from serp.errors import SettingsError
from serp.settings.section import Section

Chance = Annotated[float, Field(ge=0, lt=1)]
"""A probability, at least 0 and below 1."""


class WorldOptions(Section):
    """The options of a world that is made of a file (`serp.file_task`)."""

    failure: Chance = 0.0
    """Probability that an action does nothing."""
    slip: Chance = 0.0
    """Probability that another action happens instead: one of those whose precondition holds, each
    as likely as the others. Where there is none, nothing happens."""
    noise: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    """Standard deviation of the change of a number, as a share of this change. What actions and
    processes change by d becomes a change by d · (1 + noise · z), with z from the standard normal
    distribution, before events are looked at."""
    max_steps: Annotated[int, Field(ge=1, le=COUNTED)] = 1_000
    """Steps after which an episode is cut off."""

    @model_validator(mode="after")
    def _something_may_work(self) -> Self:
        if self.failure + self.slip > 1.0:
            raise ValueError(
                f"failure and world.slip are {self.failure!r} and {self.slip!r}; an action fails, "
                "slips or is carried out, so together they must be at most 1"
            )
        return self

    @classmethod
    def from_dict(cls, values: Any) -> WorldOptions | None:
        """Return the options that `as_dict` wrote; None for None.

        Raises:
            SettingsError: They are no options.
        """
        if values is None:
            return None
        if not isinstance(values, Mapping):
            raise SettingsError(f"{values!r} does not describe a world")
        return cls(**values)

    @classmethod
    def section(cls) -> str:
        """Return what messages call the options."""
        return "world"
