"""The options of `tune`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field, NonNegativeInt, PositiveInt, field_validator, model_validator

from serp._util.numbers import whole
from serp.comparison.algorithms import SERP
from serp.comparison.engines import LOCAL
from serp.comparison.plan import SettingChanges
from serp.settings.section import Section

FIRST_SEED: Final = 1_000
"""Seeds from here on are for tuning, those from 0 on for the results that are reported."""

Objective = Literal["training", "evaluation"]


class TuningRequest(Section):
    """The options of `serp.tune`, which describes them; None stands for the default."""

    vary: Mapping[str, Any]
    algorithm: str = SERP
    objective: Objective = "training"
    trials: PositiveInt = 50
    seeds: tuple[NonNegativeInt, ...] = Field(
        tuple(range(FIRST_SEED, FIRST_SEED + 3)), min_length=1
    )
    env_steps: PositiveInt | None = None
    settings: SettingChanges = Field(default_factory=dict)
    storage: str | None = None
    study: str | None = None
    prune: bool = False
    seed: NonNegativeInt = 0
    engine: str = LOCAL
    address: str | None = None
    jobs: PositiveInt | None = None
    quiet: bool = False

    @classmethod
    def section(cls) -> str:
        """Return the first part of the names in messages."""
        return "tune"

    @model_validator(mode="before")
    @classmethod
    def _given(cls, values: dict[str, Any]) -> dict[str, Any]:
        return {name: value for name, value in values.items() if value is not None}

    @model_validator(mode="after")
    def _addressed(self) -> TuningRequest:
        if self.address is not None and self.engine == LOCAL:
            raise ValueError("address is for an engine of a cluster, such as engine = 'ray'")
        return self

    @field_validator("vary", mode="before")
    @classmethod
    def _varied(cls, value: Any) -> Any:
        if not isinstance(value, Mapping):
            raise ValueError("must be a mapping, such as {'planner.depth': '2..7'}")
        return value

    @field_validator("seeds", mode="before")
    @classmethod
    def _seeds(cls, value: Any) -> Any:
        count = whole(value, 1)
        if count is not None:
            return tuple(range(FIRST_SEED, FIRST_SEED + count))
        return tuple(dict.fromkeys(value)) if isinstance(value, Iterable) else ()

    @field_validator("storage", mode="before")
    @classmethod
    def _storage(cls, value: Any) -> str:
        if not isinstance(value, str | os.PathLike) or "\0" in str(value):
            raise ValueError("must be a file, or the URL of a database")
        return str(value) if "://" in str(value) else f"sqlite:///{Path(value)}"
