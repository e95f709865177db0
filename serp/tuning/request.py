"""The options of `tune`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Final, Literal

from pydantic import NonNegativeInt, PositiveInt, field_validator

from serp.comparison.algorithms import SERP
from serp.comparison.engines import TrialsRequest

FIRST_SEED: Final = 1_000
"""Seeds from here on are for tuning, those from 0 on for the results that are reported."""

Objective = Literal["training", "evaluation"]


class TuningRequest(TrialsRequest):
    """The options of `serp.tune`, which describes them; None stands for the default."""

    first_seed: ClassVar[int] = FIRST_SEED
    seeds: tuple[NonNegativeInt, ...] = tuple(range(FIRST_SEED, FIRST_SEED + 3))
    vary: Mapping[str, Any]
    algorithm: str = SERP
    objective: Objective = "training"
    trials: PositiveInt = 50
    env_steps: PositiveInt | None = None
    storage: str | None = None
    study: str | None = None
    prune: bool = False
    seed: NonNegativeInt = 0

    @classmethod
    def section(cls) -> str:
        """Return the first part of the names in messages."""
        return "tune"

    @field_validator("vary", mode="before")
    @classmethod
    def _varied(cls, value: Any) -> Any:
        if not isinstance(value, Mapping):
            raise ValueError("must be a mapping, such as {'planner.depth': '2..7'}")
        return value

    @field_validator("storage", mode="before")
    @classmethod
    def _storage(cls, value: Any) -> str:
        if not isinstance(value, str | os.PathLike) or "\0" in str(value):
            raise ValueError("must be a file, or the URL of a database")
        return str(value) if "://" in str(value) else f"sqlite:///{Path(value)}"
