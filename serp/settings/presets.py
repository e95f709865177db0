"""The two presets, and the settings that follow from a preset, a task and a user's changes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from serp._util.text import did_you_mean
from serp.errors import SettingsError
from serp.settings.settings import Changes, Settings, entries

PRESETS: Final[Mapping[str, Changes]] = {
    # Algorithm 1 and section 4 of the paper. Where the paper leaves a choice open, the simplest
    # one: vetoes by the next step, no filter, no target network.
    "paper": {
        "planner": {"discount": 0.9},
        "arbiter": {
            "rho": 0.0,
            "rho_increment": 0.01,
            "rho_unit": "episode",
            "veto_horizon": "step",
        },
        "learner": {
            "learning_rate": 1e-3,
            "discount": 0.9,
            "epsilon_start": 0.3,
            "epsilon_end": 0.3,
            "loss": "mse",
            "double": False,
            "n_step": 1,
            "clip_targets": False,
            "target_period": None,
            "target_polyak": None,
            "gradient_clip": None,
            "mask_targets": False,
            # D keeps every sample: up to 1,000 episodes of 500 steps.
            "buffer_size": 500_000,
            "pretrain_updates": 500,
        },
        "training": {"random_steps": 500},
    },
    # The best known choices.
    "default": {
        # With two control periods per edge the lookahead is twice as long at the same cost.
        "planner": {"name": "far-sight", "repeat": 2},
        "adaptation": {"mode": "full", "min_visits": 4},
        "guide": {"strategy": "evidence"},
        "learner": {
            "symmetry": True,
            "members": 3,
            "layer_norm": True,
            "batch_size": 32,
            "target_period": None,
            "target_polyak": 0.005,
            # The learner begins with what the planner does.
            "epsilon_start": 0.1,
            "epsilon_end": 0.02,
            "epsilon_steps": 3000,
        },
    },
}


def resolve(
    preset: str = "default",
    task_settings: Mapping[str, Changes] | None = None,
    changes: Changes | None = None,
) -> Settings:
    """Return the settings of a preset, changed by the task and then by the caller.

    Raises:
        SettingsError: The preset or a setting does not exist, or a value is out of range.
    """
    if not isinstance(preset, str) or preset not in PRESETS:
        raise SettingsError(f"there is no preset `{preset}`; {did_you_mean(str(preset), PRESETS)}")
    of_task = {} if task_settings is None else task_settings
    for key, _ in entries(of_task, "the task's settings", '{"*": {"planner": {"depth": 5}}}'):
        if key != "*" and key not in PRESETS:
            advice = did_you_mean(str(key), ["*", *PRESETS])
            if key in Settings.model_fields:
                advice = f'settings of every preset are written {{"*": {{{key!r}: ...}}}}'
            raise SettingsError(
                f"the task changes settings of a preset `{key}`, which does not exist; {advice}"
            )
    settings = Settings().replace(PRESETS[preset])
    for key in ("*", preset):
        settings = settings.replace(of_task.get(key, {}))
    return settings.replace({} if changes is None else changes)
