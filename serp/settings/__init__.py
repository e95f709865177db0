"""Settings: six sections, two presets, and how they are combined."""

from serp.settings.presets import PRESETS, resolve
from serp.settings.section import Section
from serp.settings.sections import (
    AdaptationSettings,
    ArbiterSettings,
    GuideSettings,
    LearnerSettings,
    PlannerSettings,
    TrainingSettings,
)
from serp.settings.settings import Changes, Settings

__all__ = [
    "PRESETS",
    "AdaptationSettings",
    "ArbiterSettings",
    "Changes",
    "GuideSettings",
    "LearnerSettings",
    "PlannerSettings",
    "Section",
    "Settings",
    "TrainingSettings",
    "resolve",
]
