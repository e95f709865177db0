"""Former settings, refused with a message that says what is there instead."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from serp.errors import SettingsError

_SECTIONS: Final = {"correction": "adaptation"}
_SETTINGS: Final = {
    ("adaptation", "tries"): "min_visits",
}
_BY_EVIDENCE: Final = "the strategy `evidence` decides on lead and imitation by returns"
_REMOVED: Final = {
    ("planner", "leaf_value"): "the planner `far-sight` values the leaves by itself",
    ("arbiter", "rho_max"): "ρ grows to 1; `arbiter.rho_increment=0` keeps it as it is",
    ("arbiter", "surety"): _BY_EVIDENCE,
    ("arbiter", "broken_promises"): "three failures, and one in 1,000 steps, are tolerated",
    ("arbiter", "after_veto"): "after a veto the planner acts",
    ("arbiter", "exploration_slack"): "exploration is among the actions that no veto refuses",
    ("arbiter", "indifferent"): _BY_EVIDENCE,
    ("arbiter", "imitation"): _BY_EVIDENCE,
    ("adaptation", "nonlinear"): "random features are used where they have predicted better",
    **dict.fromkeys(
        (
            ("guide", "jump_stages"),
            ("guide", "jump_tolerance"),
            ("guide", "restrict_slack"),
            ("guide", "imitation_steps"),
            ("guide", "margin"),
        ),
        "the strategies that read it are gone; `evidence` and `mixture` remain",
    ),
    ("learner", "imitation_weight"): _BY_EVIDENCE,
    ("learner", "protected_share"): "batches are drawn from all samples alike",
}
_VALUES: Final = {("adaptation", "mode", "literals"): "parameters"}


def refuse_old_section(section: Any, values: Any) -> None:
    """Refuse the former name of a section, naming its settings as well.

    Raises:
        SettingsError: The section was renamed.
    """
    if not isinstance(section, str) or section not in _SECTIONS:
        return
    new = _SECTIONS[section]
    text = f"section `{section}` is now called `{new}`"
    for setting in values if isinstance(values, Mapping) else ():
        name = _SETTINGS.get((new, setting), setting)
        text += f", `{section}.{setting}` is `{new}.{name}`"
    raise SettingsError(text)


def refuse_old_names(section: str, setting: Any, value: Any) -> None:
    """Refuse a former setting, and the former name of a setting or of its value.

    Raises:
        SettingsError: It was renamed or removed.
    """
    instead = _REMOVED.get((section, setting)) if isinstance(setting, str) else None
    if instead is not None:
        raise SettingsError(f"setting `{section}.{setting}` was removed: {instead}")
    name = _SETTINGS.get((section, setting)) if isinstance(setting, str) else None
    if name is not None:
        raise SettingsError(f"setting `{section}.{setting}` is now called `{section}.{name}`")
    word = _VALUES.get((section, setting, value)) if isinstance(value, str) else None
    if word is not None:
        raise SettingsError(f"{section}.{setting}: `{value}` is now called `{word}`")
