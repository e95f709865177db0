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


def characteristics_of(
    algorithm: Algorithm, settings: Settings, source: Source
) -> Mapping[str, str]:
    """Return the characteristics of one of serp's algorithms: name → text.

    Args:
        algorithm: The algorithm.
        settings: All its settings.
        source: The source of the reward that it learns from.
    """
    planner = settings.planner
    plan = f"lookahead, depth {planner.depth}, {planner.repeat} control periods an edge"
    if settings.adaptation.mode != "off":
        plan += f", adapted ({settings.adaptation.mode})"
    if settings.bootstraps_leaves:
        plan += f", the learner's values at its leaves ({planner.leaf_value})"
    vetoes = "unsafe and not applicable"
    if settings.arbiter.veto_horizon == "lookahead":
        vetoes += ", and what leads there within the lookahead"
    if settings.arbiter.r_min is not None:
        vetoes += f", reward below {settings.arbiter.r_min:g}"
    baseline = algorithm.kind == "baseline"
    return {
        "learner": "none" if algorithm.kind == "planner" else f"DQN, preset {algorithm.preset}",
        "learned from": "none" if algorithm.kind == "planner" else REWARDS[source],
        "planner": "none" if baseline else plan,
        "who acts": _who_acts(algorithm, settings),
        "vetoes": "none" if baseline else vetoes,
    }


def _who_acts(algorithm: Algorithm, settings: Settings) -> str:
    match algorithm.kind:
        case "planner":
            return "planner"
        case "baseline":
            return "learner"
        case _:
            return settings.guide.strategy


def settings_in_use(algorithm: Algorithm, settings: Settings) -> dict[str, dict[str, Any]] | None:
    """Return section → setting → JSON value of what an algorithm reads; None if it is external."""
    if algorithm.kind == "external":
        return None
    said = settings.as_dict()
    said["training"] = _without(said["training"], _NOT_OF_TRAINING)
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


def _without(values: Mapping[str, Any], names: tuple[str, ...]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name not in names}
