"""All settings of a training."""

from __future__ import annotations

from collections.abc import ItemsView, Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from serp._util.text import did_you_mean
from serp.errors import SettingsError
from serp.settings.renamed import refuse_old_names, refuse_old_section
from serp.settings.section import Section, from_json
from serp.settings.sections import (
    AdaptationSettings,
    ArbiterSettings,
    GuideSettings,
    LearnerSettings,
    PlannerSettings,
    TrainingSettings,
)

Changes = Mapping[str, Mapping[str, Any]]
"""Section → setting → value."""


class Settings(BaseModel):
    """All settings, by section; immutable.

    `serp.Settings()` has the defaults; `serp.Settings(planner=serp.PlannerSettings(depth=3))`
    differs in one of them.

    Raises:
        SettingsError: A section is unknown or not of its class.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    planner: PlannerSettings = Field(default_factory=PlannerSettings)
    adaptation: AdaptationSettings = Field(default_factory=AdaptationSettings)
    arbiter: ArbiterSettings = Field(default_factory=ArbiterSettings)
    guide: GuideSettings = Field(default_factory=GuideSettings)
    learner: LearnerSettings = Field(default_factory=LearnerSettings)
    training: TrainingSettings = Field(default_factory=TrainingSettings)

    def __init__(self, **sections: Any) -> None:
        try:
            super().__init__(**sections)
        except ValidationError as error:
            wrong = error.errors(include_url=False)[0]
            section = str(wrong["loc"][0])
            wanted = f"{section.title()}Settings"
            raise SettingsError(
                f"settings: section `{section}` must be a {wanted}, not {wrong['input']!r}"
            ) from None

    def replace(self, changes: Changes) -> Settings:
        """Return the settings with changes.

        Raises:
            SettingsError: `changes` is not such a mapping, a section or setting does not exist,
                or a value is out of range.
        """
        sections: dict[str, Section] = {}
        for name, values in entries(changes, "settings", '{"planner": {"depth": 5}}'):
            refuse_old_section(name, values)
            if name not in Settings.model_fields:
                known = did_you_mean(str(name), Settings.model_fields)
                raise SettingsError(f"there is no section `{name}`; {known}")
            section: Section = getattr(self, name)
            first, value = next(iter(section))
            example = f"{{{first!r}: {value!r}}}"
            changed = dict(entries(values, f"settings: section `{name}`", example))
            for setting, value in changed.items():
                refuse_old_names(name, setting, value)
            sections[name] = section.replace(**{str(key): v for key, v in changed.items()})
        return self.model_copy(update=sections)

    def as_dict(self) -> dict[str, dict[str, Any]]:
        """Return section → setting → JSON value (tuples as lists, infinity as "inf")."""
        return {name: section.as_dict() for name, section in self}

    @classmethod
    def from_dict(cls, sections: Changes) -> Settings:
        """Return the settings that `as_dict` wrote.

        Raises:
            SettingsError: A name is unknown, or a value is out of range.
        """
        return cls().replace(
            {
                name: {setting: from_json(value) for setting, value in values.items()}
                if isinstance(values, Mapping)
                else values
                for name, values in entries(sections, "settings", "{}")
            }
        )


def entries(value: Any, what: str, example: str) -> ItemsView[Any, Any]:
    """Return the items of a mapping.

    Raises:
        SettingsError: It is not a mapping.
    """
    if not isinstance(value, Mapping):
        raise SettingsError(f"{what} must be a mapping such as {example}, not {value!r}")
    return value.items()
