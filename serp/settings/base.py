"""What all sections of the settings have in common: frozen, with a range for every value."""

from __future__ import annotations

import math
from typing import Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError, field_validator
from pydantic_core import ErrorDetails

from serp._util.text import did_you_mean
from serp.errors import SettingsError

_INFINITIES = {math.inf: "inf", -math.inf: "-inf"}
"""JSON has no infinity."""


_WANTED = {
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "float_type": "must be a number",
    "finite_number": "must be a finite number",
    "bool_type": "must be true or false",
    "string_type": "must be a text",
    "tuple_type": "must be a list",
}
"""Kind of problem, as pydantic names it → what is wanted, in plain words."""


class Section(BaseModel):
    """A section of the settings: frozen, and checked when it is made.

    NumPy's numbers are taken over as Python's. A truth value is no number, and NaN is none either.

    Raises:
        SettingsError: A value is outside its range, of another type, or unknown.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, use_attribute_docstrings=True
    )

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise SettingsError(_refusal(type(self), error)) from None

    @field_validator("*", mode="before")
    @classmethod
    def _as_python(cls, value: Any) -> Any:
        if isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim == 1):
            return tuple(_plain(entry) for entry in value)
        return _plain(value)

    @classmethod
    def section(cls) -> str:
        """Return what the section is called: `PlannerSettings` is `planner`."""
        return cls.__name__.removesuffix("Settings").lower()

    def replace(self, **changes: Any) -> Self:
        """Return the section with other values.

        Raises:
            SettingsError: A value is outside its range, of another type, or unknown.
        """
        return type(self)(**{**dict(self), **changes})

    def as_dict(self) -> dict[str, Any]:
        """Return setting → JSON value (tuples as lists, infinity as "inf")."""
        return {name: _to_json(value) for name, value in self}


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _to_json(value: Any) -> Any:
    if isinstance(value, tuple):
        return list(value)
    return _INFINITIES.get(value, value) if isinstance(value, float) else value


def from_json(value: Any) -> Any:
    """Return what `Section.as_dict` wrote as such a value."""
    if isinstance(value, str):
        return {word: number for number, word in _INFINITIES.items()}.get(value, value)
    return value


def _refusal(section: type[Section], error: ValidationError) -> str:
    """Say which values are refused, and what is allowed instead."""
    said = [_said(section, problem) for problem in error.errors(include_url=False)]
    return "; ".join(dict.fromkeys(said))


def _said(section: type[Section], problem: ErrorDetails) -> str:
    name = section.section()
    why = _WANTED.get(problem["type"], problem["msg"])
    why = why.removeprefix("Value error, ").replace("Input should be", "must be")
    if not problem["loc"]:
        return f"{name}.{why}"
    setting = str(problem["loc"][0])
    if problem["type"] == "extra_forbidden":
        known = did_you_mean(setting, section.model_fields)
        return f"there is no setting `{name}.{setting}`; {known}"
    return f"{name}.{setting} {why}, not {problem['input']!r}"
