"""Former names of settings, refused with a message that gives the new name."""

from __future__ import annotations

from typing import Any, Final

from serp.errors import SettingsError

_SECTIONS: Final = {"correction": "adaptation"}
_SETTINGS: Final = {
    ("adaptation", "tries"): "min_visits",
    ("arbiter", "surety"): "confidence_margin",
    ("arbiter", "imitation"): "imitation_weight",
    ("arbiter", "broken_promises"): "max_lookahead_failures",
}
_VALUES: Final = {("adaptation", "mode", "literals"): "parameters"}


def refuse_old_names(section: Any, setting: Any = None, value: Any = None) -> None:
    """Refuse a former name.

    Raises:
        SettingsError: The section, the setting or its value was renamed.
    """
    if setting is None:
        if isinstance(section, str) and section in _SECTIONS:
            raise SettingsError(f"section `{section}` is now called `{_SECTIONS[section]}`")
        return
    name = _SETTINGS.get((section, setting)) if isinstance(setting, str) else None
    if name is not None:
        raise SettingsError(f"setting `{section}.{setting}` is now called `{section}.{name}`")
    word = _VALUES.get((section, setting, value)) if isinstance(value, str) else None
    if word is not None:
        raise SettingsError(f"{section}.{setting}: `{value}` is now called `{word}`")
