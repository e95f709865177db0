"""The settings that are tuned, and their values.

learner.learning_rate=log:1e-4..1e-2    a range, here on a logarithmic scale
planner.depth=2..7                      whole numbers, if the setting is one
learner.hidden=[64,64],[128,128]        values
learner.guarded_targets                 all values, of a truth value or a choice of words
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal, get_args, get_origin

from pydantic import TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from serp._util.text import did_you_mean
from serp.errors import SettingsError
from serp.settings import Changes, Settings

FORMS: Final = "A..B, log:A..B or A,B,..."


@dataclass(frozen=True)
class Dimension:
    """The values of one setting.

    Attributes:
        section, setting: Its name.
        low, high: Ends of the range; None for choices.
        log: Whether the range is on a logarithmic scale.
        choices: The values, if there is no range.
    """

    section: str
    setting: str
    low: float | None = None
    high: float | None = None
    log: bool = False
    choices: tuple[Any, ...] = ()

    @property
    def name(self) -> str:
        """`section.setting`."""
        return f"{self.section}.{self.setting}"

    def suggest(self, trial: Any) -> Any:
        """Return the value that an Optuna trial suggests."""
        if self.low is None or self.high is None:
            # Optuna takes neither lists nor tuples as values.
            texts = [json.dumps(choice) for choice in self.choices]
            value = json.loads(trial.suggest_categorical(self.name, texts))
            return tuple(value) if isinstance(value, list) else value
        suggest = trial.suggest_int if isinstance(self.low, int) else trial.suggest_float
        return suggest(self.name, self.low, self.high, log=self.log)

    def parameter(self, value: Any) -> Any:
        """Return a value of the setting as Optuna's parameter; None if it is not one of these."""
        if self.low is None or self.high is None:
            return json.dumps(value) if value in self.choices else None
        numeric = isinstance(value, int | float) and not isinstance(value, bool)
        return value if numeric and self.low <= value <= self.high else None


def dimensions(vary: Mapping[str, Any]) -> tuple[Dimension, ...]:
    """Return what is varied; a value is a text as above, or a list of values.

    Raises:
        SettingsError: A setting does not exist, or a value is outside its range.
    """
    if not vary:
        raise SettingsError("say what to tune, such as learner.learning_rate=log:1e-4..1e-2")
    return tuple(_dimension(name, given) for name, given in vary.items())


def changes_of(values: Mapping[Dimension, Any]) -> Changes:
    """Return section → setting → value."""
    changes: dict[str, dict[str, Any]] = {}
    for dimension, value in values.items():
        changes.setdefault(dimension.section, {})[dimension.setting] = value
    return changes


def _dimension(name: str, given: Any) -> Dimension:
    section, field = _field(name)
    setting = name.partition(".")[2]
    if given in (None, ""):
        choices = _all_values(field)
        if not choices:
            raise SettingsError(f"{name}: say which values: {FORMS}")
        return Dimension(section, setting, choices=choices)
    if not isinstance(given, str):
        if not isinstance(given, Sequence) or not given:
            raise SettingsError(f"{name}: expected a list of values or a text such as {FORMS}")
        return Dimension(section, setting, choices=_checked(name, field, given))
    ends = re.fullmatch(r"\s*(log:)?\s*([^,\s]+?)\s*\.\.\s*([^,\s]+?)\s*", given)
    if ends is None:
        texts = re.split(r",(?![^\[]*\])", given)  # commas outside brackets
        return Dimension(section, setting, choices=_checked(name, field, map(_value, texts)))
    whole = int in _types(field) and float not in _types(field)
    try:
        low, high = (int(text) if whole else float(text) for text in ends.groups()[1:])
    except ValueError:
        kind = "whole numbers" if whole else "numbers"
        raise SettingsError(f"{name}={given}: a range is of {kind}") from None
    if not {int, float} & {*_types(field)} or not low < high or (ends[1] and low <= 0):
        raise SettingsError(
            f"{name}={given}: a range is for numbers, its first end is smaller than its second, "
            "and on a logarithmic scale above 0"
        )
    _checked(name, field, (low, high))
    return Dimension(section, setting, low, high, log=ends[1] is not None)


def _field(name: str) -> tuple[str, FieldInfo]:
    """Return section and field of a setting."""
    section, _, setting = name.partition(".")
    sections = {key: type(value) for key, value in Settings()}
    if section not in sections:
        raise SettingsError(f"there is no section `{section}`; {did_you_mean(section, sections)}")
    fields = sections[section].model_fields
    if setting not in fields:
        known = did_you_mean(setting, fields)
        raise SettingsError(f"there is no setting `{section}.{setting}`; {known}")
    return section, fields[setting]


def _types(field: FieldInfo) -> list[Any]:
    """Return the types of a field's values, in their order."""

    def inside(kind: Any) -> list[Any]:
        if get_origin(kind) is Annotated:
            return inside(get_args(kind)[0])
        if get_origin(kind) in (None, Literal, tuple):
            return [kind]
        return [found for part in get_args(kind) for found in inside(part)]

    return inside(field.annotation)


def _all_values(field: FieldInfo) -> tuple[Any, ...]:
    """Return all values of a field, if they can be listed."""
    values: list[Any] = []
    for kind in _types(field):
        if kind is bool:
            values += [False, True]
        elif get_origin(kind) is Literal:
            values += get_args(kind)
        else:
            return ()
    return tuple(values)


def _value(text: str) -> Any:
    text = text.strip()
    if text in ("none", "None"):
        return None
    try:
        return json.loads(text)
    except ValueError:
        return text


def _checked(name: str, field: FieldInfo, values: Any) -> tuple[Any, ...]:
    """Return values in the form of the setting; refuse those that it does not take."""
    kind: Any = field.annotation
    adapter = TypeAdapter[Any](Annotated[kind, *field.metadata] if field.metadata else kind)
    found = []
    for value in values:
        plain = tuple(value) if isinstance(value, list) else value
        try:
            found.append(adapter.validate_python(plain, strict=True))
        except ValidationError as error:
            why = error.errors(include_url=False)[0]["msg"].replace("Input should be", "must be")
            raise SettingsError(f"{name} {why}, not {value!r}") from None
    return tuple(found)
