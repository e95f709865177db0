"""All settings of a training in one place, and the two presets."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from serp.arbiter import ArbiterSettings
from serp.domain.source import did_you_mean
from serp.errors import SettingsError
from serp.learning.settings import DQNSettings
from serp.planning.settings import PlannerSettings


@dataclass(frozen=True, kw_only=True)
class TrainingSettings:
    """Settings of the training loop.

    Attributes:
        inputs: What the learner sees: the `observation`, the grounded `state`, or `both`.
        random_steps: Size of D_0 in env steps: actions drawn uniformly (what is predicted unsafe
            is refused as ever), on which the learner is pretrained before Algorithm 1 starts.
        env_steps: Budget of a training for which none is given.
        episode_steps: An episode that the environment does not end is truncated after so many
            steps: runs are saved and stopped between episodes.
        checkpoint_seconds: Most time between two checkpoints, which are made between episodes;
            they are made more often where they are cheap.
        tensorboard: Whether to write TensorBoard events as well (extra `tensorboard`).
    """

    inputs: Literal["observation", "state", "both"] = "both"
    random_steps: int = 0
    env_steps: int = 20_000
    episode_steps: int = 10_000
    checkpoint_seconds: float = 15.0
    tensorboard: bool = False

    def __post_init__(self) -> None:
        if self.inputs not in ("observation", "state", "both"):
            raise SettingsError(
                f"training: inputs must be observation, state or both, not {self.inputs!r}"
            )
        for name, least in (("random_steps", 0), ("env_steps", 1), ("episode_steps", 1)):
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool) or value < least:
                raise SettingsError(
                    f"training: {name} must be a whole number >= {least}, not {value!r}"
                )
        if not isinstance(self.tensorboard, bool):
            raise SettingsError(
                f"training: tensorboard must be true or false, not {self.tensorboard!r}"
            )
        if not self.checkpoint_seconds >= 0:
            raise SettingsError(
                f"training: checkpoint_seconds must be >= 0, not {self.checkpoint_seconds!r}"
            )


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Everything that can be set, by section."""

    planner: PlannerSettings = field(default_factory=PlannerSettings)
    arbiter: ArbiterSettings = field(default_factory=ArbiterSettings)
    learner: DQNSettings = field(default_factory=DQNSettings)
    training: TrainingSettings = field(default_factory=TrainingSettings)

    def replace(self, changes: Mapping[str, Mapping[str, Any]]) -> Settings:
        """Return the settings with changes: section → setting → value.

        Raises:
            SettingsError: A section or setting does not exist, or a value is out of range.
        """
        sections: dict[str, Any] = {}
        known = [f.name for f in dataclasses.fields(self)]
        for section, values in changes.items():
            if section not in known:
                raise SettingsError(
                    f"there is no section `{section}`; {did_you_mean(section, known)}"
                )
            current = getattr(self, section)
            names = [f.name for f in dataclasses.fields(current)]
            for name in values:
                if name not in names:
                    raise SettingsError(
                        f"there is no setting `{section}.{name}`; {did_you_mean(name, names)}"
                    )
            try:
                sections[section] = dataclasses.replace(current, **values)
            except TypeError as error:
                raise SettingsError(
                    f"{section}: a setting has a value of the wrong kind: {error}"
                ) from None
        return dataclasses.replace(self, **sections)

    def as_dict(self) -> dict[str, dict[str, Any]]:
        """Return section → setting → JSON value (tuples as lists, infinity as "inf")."""
        return {
            section: {name: _to_json(value) for name, value in values.items()}
            for section, values in dataclasses.asdict(self).items()
        }

    @classmethod
    def from_dict(cls, sections: Mapping[str, Mapping[str, Any]]) -> Settings:
        """Return the settings that `as_dict` wrote.

        Raises:
            SettingsError: Something in it is unknown or out of range.
        """
        return cls().replace(
            {
                section: {name: _from_json(value) for name, value in values.items()}
                for section, values in sections.items()
            }
        )


def _to_json(value: Any) -> Any:
    if isinstance(value, tuple):
        return list(value)
    return "inf" if value == float("inf") else value


def _from_json(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(value)
    return float("inf") if value == "inf" else value


PRESETS: Mapping[str, Mapping[str, Mapping[str, Any]]] = {
    # Algorithm 1 and section 4 to the letter. What the paper leaves open is left plain: one step
    # of veto, no filter, no target network.
    "paper": {
        "planner": {"discount": 0.9},
        "arbiter": {
            "rho": 0.0,
            "rho_increment": 0.01,
            "rho_unit": "episode",
            "veto_horizon": "step",
            "exploration_slack": None,
            "indifferent": "first",
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
            "protected_share": 0.0,
            "gradient_clip": None,
            "mask_targets": False,
            # D aggregates every sample: as many as 1,000 episodes of 500 steps have.
            "buffer_size": 500_000,
            "pretrain_updates": 500,
        },
        "training": {"random_steps": 500},
    },
    # What gives the best result today; see docs/cartpole.md for what each choice is worth.
    "default": {
        # Two control periods an edge see twice as far at the same cost.
        "planner": {"depth": 5, "repeat": 2, "discount": 0.99},
        "arbiter": {
            "rho": 0.3,
            "rho_increment": 0.00014,
            "rho_unit": "step",
            "veto_horizon": "lookahead",
            "exploration_slack": float("inf"),
            "indifferent": "learner",
        },
        "learner": {
            "members": 3,
            "layer_norm": True,
            "discount": 0.95,
            "target_period": None,
            "target_polyak": 0.005,
            "epsilon_end": 0.02,
            "epsilon_steps": 3000,
        },
    },
}


def resolve(
    preset: str = "default",
    task_settings: Mapping[str, Mapping[str, Mapping[str, Any]]] | None = None,
    changes: Mapping[str, Mapping[str, Any]] | None = None,
) -> Settings:
    """Return the settings of a preset, as changed by the task and then by the caller.

    Raises:
        SettingsError: The preset or a setting does not exist, or a value is out of range.
    """
    if preset not in PRESETS:
        raise SettingsError(f"there is no preset `{preset}`; {did_you_mean(preset, PRESETS)}")
    for key in task_settings or {}:
        if key != "*" and key not in PRESETS:
            raise SettingsError(
                f"the task changes settings of a preset `{key}`, which does not exist; "
                f"{did_you_mean(key, ['*', *PRESETS])}"
            )
    settings = Settings().replace(PRESETS[preset])
    for key in ("*", preset):
        settings = settings.replace((task_settings or {}).get(key, {}))
    return settings.replace(changes or {})
