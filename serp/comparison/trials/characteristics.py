"""Characteristics of an algorithm, for the report's table of differences."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from serp.comparison.algorithms import Algorithm
from serp.control.registry import find_strategy, strategy_names
from serp.settings import Settings
from serp.tasks.reward import Source

REWARDS: Final[Mapping[Source, str]] = {
    "domain": "rewards of the domain file",
    "environment": "reward of the environment",
    "sum": "reward of the environment plus those of the domain file",
}
_NOT_OF_TRAINING: Final = (
    "env_steps",
    "units",
    "checkpoint_seconds",
    "slow_step_seconds",
    "tensorboard",
)
"""Settings that a comparison does not read."""


def characteristics_of(algorithm: Algorithm, settings: Settings, source: Source) -> dict[str, str]:
    """Return the characteristics of one of serp's algorithms: name → text."""
    learns, plans = algorithm.kind != "planner", algorithm.kind != "baseline"
    acting = {"planner": "planner", "baseline": "learner"}
    return {
        "learner": f"DQN, preset {algorithm.preset}" if learns else "none",
        "learned from": REWARDS[source] if learns else "none",
        "planner": settings.planner.name if plans else "none",
        "who acts": acting.get(algorithm.kind, settings.guide.strategy),
        "vetoes": "by the domain file" if plans else "none",
    }


def settings_in_use(algorithm: Algorithm, settings: Settings) -> dict[str, dict[str, Any]] | None:
    """Return section → setting → JSON value of what an algorithm reads; None if it is external."""
    if algorithm.kind == "external":
        return None
    said = settings.as_dict()
    for name in _NOT_OF_TRAINING:
        del said["training"][name]
    if algorithm.kind == "baseline":
        return {name: said[name] for name in ("learner", "training")}
    if algorithm.kind == "planner":
        return {name: said[name] for name in ("planner", "adaptation")}
    own = find_strategy(settings.guide.strategy).reads
    for strategy in map(find_strategy, strategy_names()):
        for setting in set(strategy.reads).difference(own):
            section, _, name = setting.partition(".")
            said[section].pop(name, None)
    return said
