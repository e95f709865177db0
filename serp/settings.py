"""All settings of a training in one place, and the two presets."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import ItemsView, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from serp._util.numbers import real, truth, whole
from serp.adaptation.settings import AdaptationSettings
from serp.control.arbiter import ArbiterSettings
from serp.control.strategies.settings import GuideSettings
from serp.errors import SettingsError
from serp.learning.settings import DQNSettings
from serp.pddl.source import did_you_mean
from serp.planning.settings import PlannerSettings


@dataclass(frozen=True, kw_only=True)
class TrainingSettings:
    """Settings of the training loop.

    Attributes:
        reward: What the learner learns from: what the `task` declares (`Task.reward`), the rewards
            of the `domain` file, the `environment`'s, or the `sum` of both. The planner always
            goes by the domain file.
        inputs: What the learner sees: the `observation`, the grounded `state`, or `both`.
        random_steps: Size of D_0 in env steps: actions drawn uniformly (what is unsafe or too risky
            is refused as ever), on which the learner is pretrained before Algorithm 1 starts.
        env_steps: Budget of a training for which none is given.
        units: Budget of such a training in units of `arbiter.rho_unit` (games, say), instead of
            env steps; None for none.
        episode_steps: An episode that the environment does not end is truncated after so many
            steps: runs are saved and stopped between episodes.
        checkpoint_seconds: Most time between two checkpoints, which are made between episodes;
            they are made more often where they are cheap.
        slow_step_seconds: A step or reset of the environment that takes longer is reported while it
            hangs, once a run; infinity: none is.
        tensorboard: Whether to write TensorBoard events as well (extra `tensorboard`).
    """

    reward: Literal["task", "domain", "environment", "sum"] = "task"
    inputs: Literal["observation", "state", "both"] = "both"
    random_steps: int = 0
    env_steps: int = 20_000
    units: int | None = None
    episode_steps: int = 10_000
    checkpoint_seconds: float = 15.0
    slow_step_seconds: float = 30.0
    tensorboard: bool = False

    def __post_init__(self) -> None:
        rewards = ("task", "domain", "environment", "sum")
        if not isinstance(self.reward, str) or self.reward not in rewards:
            raise SettingsError(
                f"training: reward must be task, domain, environment or sum, not {self.reward!r}"
            )
        if not isinstance(self.inputs, str) or self.inputs not in ("observation", "state", "both"):
            raise SettingsError(
                f"training: inputs must be observation, state or both, not {self.inputs!r}"
            )
        for name, least in (("random_steps", 0), ("env_steps", 1), ("episode_steps", 1)):
            self._take(name, whole(getattr(self, name), least), f"a whole number >= {least}")
        if self.units is not None:
            self._take("units", whole(self.units, 1), "a whole number >= 1, or none")
        self._take("tensorboard", truth(self.tensorboard), "true or false")
        seconds = real(self.checkpoint_seconds, infinite=True)
        self._take(
            "checkpoint_seconds", seconds if seconds is None or seconds >= 0 else None, ">= 0"
        )
        slow = real(self.slow_step_seconds, infinite=True)
        self._take("slow_step_seconds", slow if slow is None or slow > 0 else None, "> 0")

    def _take(self, name: str, value: Any, allowed: str) -> None:
        """Put Python's own value in the place of a setting; None stands for one out of range."""
        if value is None:
            raise SettingsError(f"training: {name} must be {allowed}, not {getattr(self, name)!r}")
        object.__setattr__(self, name, value)


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Everything that can be set, by section."""

    planner: PlannerSettings = field(default_factory=PlannerSettings)
    correction: AdaptationSettings = field(default_factory=AdaptationSettings)
    arbiter: ArbiterSettings = field(default_factory=ArbiterSettings)
    guide: GuideSettings = field(default_factory=GuideSettings)
    learner: DQNSettings = field(default_factory=DQNSettings)
    training: TrainingSettings = field(default_factory=TrainingSettings)

    def __post_init__(self) -> None:
        for section in dataclasses.fields(self):
            value, made = getattr(self, section.name), section.default_factory
            if isinstance(made, type) and not isinstance(value, made):
                raise SettingsError(
                    f"settings: section `{section.name}` must be a {made.__name__}, not {value!r}"
                )

    @property
    def values_leaves(self) -> bool:
        """Whether the lookahead may use the learner's values at its leaves."""
        return (
            self.planner.leaf_value != "never"
            and self.guide.strategy == "mixture"
            and self.training.inputs != "observation"
        )

    def replace(self, changes: Mapping[str, Mapping[str, Any]]) -> Settings:
        """Return the settings with changes: section → setting → value.

        NumPy's numbers are taken over as Python's.

        Raises:
            SettingsError: It is no such mapping, a section or setting does not exist, or a value
                is out of range.
        """
        sections: dict[str, Any] = {}
        known = [f.name for f in dataclasses.fields(self)]
        for section, values in _entries(changes, "settings", '{"planner": {"depth": 5}}'):
            if section not in known:
                raise SettingsError(
                    f"there is no section `{section}`; {did_you_mean(str(section), known)}"
                )
            current = getattr(self, section)
            names = [f.name for f in dataclasses.fields(current)]
            plain: dict[str, Any] = {}
            example = f'{{"{names[0]}": {getattr(current, names[0])!r}}}'
            for name, value in _entries(values, f"settings: section `{section}`", example):
                if name not in names:
                    raise SettingsError(
                        f"there is no setting `{section}.{name}`; {did_you_mean(str(name), names)}"
                    )
                plain[name] = value.item() if isinstance(value, np.generic) else value
            try:
                sections[section] = dataclasses.replace(current, **plain)
            except (TypeError, ValueError) as error:
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
                if isinstance(values, Mapping)
                else values
                for section, values in _entries(sections, "settings", "{}")
            }
        )


def _entries(value: Any, what: str, example: str) -> ItemsView[Any, Any]:
    """Return the items of a mapping.

    Raises:
        SettingsError: It is none.
    """
    if not isinstance(value, Mapping):
        raise SettingsError(f"{what} must be a mapping such as {example}, not {value!r}")
    return value.items()


_INFINITIES = {"inf": math.inf, "-inf": -math.inf}
"""JSON knows no infinity."""


def _to_json(value: Any) -> Any:
    if isinstance(value, tuple):
        return list(value)
    if isinstance(value, float) and math.isinf(value):
        return "inf" if value > 0 else "-inf"
    return value


def _from_json(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(value)
    return _INFINITIES.get(value, value) if isinstance(value, str) else value


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
            "after_veto": "planner",
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
        "planner": {"depth": 5, "repeat": 2, "discount": 0.99, "leaf_value": "indifferent"},
        # The file says what the expert knows; the rest is found out.
        "correction": {"mode": "full", "tries": 4},
        "arbiter": {
            "rho": 0.3,
            "rho_increment": 0.00014,
            "rho_unit": "step",
            "surety": 1.0,
            "imitation": 1.0,
            "veto_horizon": "lookahead",
            "broken_promises": 3,
            "exploration_slack": float("inf"),
            "after_veto": "learner",
            "indifferent": "learner",
        },
        "learner": {
            "symmetry": True,
            "members": 5,
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
    if not isinstance(preset, str) or preset not in PRESETS:
        raise SettingsError(f"there is no preset `{preset}`; {did_you_mean(str(preset), PRESETS)}")
    of_task = {} if task_settings is None else task_settings
    for key, _ in _entries(of_task, "the task's settings", '{"*": {"planner": {"depth": 5}}}'):
        if key != "*" and key not in PRESETS:
            raise SettingsError(
                f"the task changes settings of a preset `{key}`, which does not exist; "
                f"{did_you_mean(str(key), ['*', *PRESETS])}"
            )
    settings = Settings().replace(PRESETS[preset])
    for key in ("*", preset):
        settings = settings.replace(of_task.get(key, {}))
    return settings.replace({} if changes is None else changes)
