"""The settings that are tuned, and their values.

learner.learning_rate=log:1e-4..1e-2    a range, here on a logarithmic scale
planner.depth=2..7                      whole numbers, if the setting is one
learner.hidden=[64,64],[128,128]        values
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from operator import attrgetter
from typing import Any

from optuna import distributions as d

from serp.errors import SettingsError
from serp.settings import Changes, Settings, assigned, setting_value

Space = dict[str, d.BaseDistribution]
"""`section.setting` → its values; choices are texts, because Optuna takes no lists."""


def space_of(vary: Mapping[str, Any]) -> Space:
    """Return what is varied; a value is a text as above, or a list of values."""
    if not vary:
        raise SettingsError(
            "give the settings to tune, such as learner.learning_rate=log:1e-4..1e-2"
        )
    return {name: _distribution(name, values) for name, values in vary.items()}


def changes_of(parameters: Mapping[str, Any]) -> Changes:
    """Return section → setting → value for the parameters of an Optuna trial."""
    return assigned(f"{name}={value}" for name, value in parameters.items())


def parameters_of(space: Space, settings: Settings) -> dict[str, Any]:
    """Return the parameters of some settings; empty if one of them is not in the space."""
    parameters: dict[str, Any] = {}
    for name, values in space.items():
        value = attrgetter(name)(settings)
        if isinstance(values, d.CategoricalDistribution):
            value = json.dumps(value)
            inside = value in values.choices
        else:
            inside = isinstance(value, int | float) and values.low <= value <= values.high
        if not inside:
            return {}
        parameters[name] = value
    return parameters


def _distribution(name: str, given: Any) -> d.BaseDistribution:
    if not isinstance(given, str | list | tuple) or not given:
        raise SettingsError(f"{name}: give the values: A..B, log:A..B or A,B,..., or a list")
    ends = None
    if isinstance(given, str):
        ends = re.fullmatch(r"\s*(log:)?\s*([^,\s]+?)\s*\.\.\s*([^,\s]+?)\s*", given)
    if ends is None:
        if isinstance(given, str):
            given = map(setting_value, re.split(r",(?![^\[]*\])", given))  # not within brackets
        return d.CategoricalDistribution([json.dumps(_checked(name, value)) for value in given])
    low, high = (_checked(name, setting_value(text)) for text in ends.groups()[1:])
    log = ends[1] is not None
    numbers = {type(low), type(high)} <= {int, float}
    if not numbers or not low < high or (log and low <= 0):
        raise SettingsError(
            f"{name}={given}: a range needs two numbers, the first smaller than the second (and, "
            "with `log:`, above 0)"
        )
    if isinstance(low, int) and isinstance(high, int):
        return d.IntDistribution(low, high, log=log)
    return d.FloatDistribution(low, high, log=log)


def _checked(name: str, value: Any) -> Any:
    """Return a value in the form of the setting; refuse one that it does not take."""
    section, _, setting = name.partition(".")
    return attrgetter(name)(Settings().replace({section: {setting: value}}))
