"""The base class of the settings' sections: immutable, with a range for every value."""

from __future__ import annotations

import math
from typing import Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError, field_validator
from pydantic_core import ErrorDetails

from serp._util.text import did_you_mean
from serp.errors import SettingsError

_INFINITIES = {math.inf: "inf", -math.inf: "-inf"}
"""JSON has no infinity: infinities are written as these strings."""


_WANTED = {
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "float_type": "must be a number",
    "finite_number": "must be a finite number",
    "bool_type": "must be true or false",
    "string_type": "must be a string",
    "tuple_type": "must be a list",
}
"""Pydantic's error type → the message."""


class Section(BaseModel):
    """A section of the settings: immutable, and validated on creation.

    NumPy numbers are converted to Python numbers. Booleans and NaN are not accepted as numbers.
    What is outside its range, of another type, or unknown is a `SettingsError`.
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
        """Return the section's name: `PlannerSettings` is `planner`."""
        return cls.__name__.removesuffix("Settings").lower()

    def replace(self, **changes: Any) -> Self:
        """Return the section with other values."""
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
    """Return the value that `Section.as_dict` wrote as a JSON value."""
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
