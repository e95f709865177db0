"""What a comparison was asked for: what its report says of it beside the numbers."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

from serp.compare.records import Trial

_PACKAGES: Final = (
    "serp",
    "numpy",
    "torch",
    "numba",
    "scipy",
    "gymnasium",
    "pymunk",
    "unified-planning",
    "stable-baselines3",
)


def versions() -> dict[str, str]:
    """Python and the packages that results depend on → version, as far as they are installed."""
    found = {"Python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def machine() -> str:
    """The kind of machine: processor, cores, operating system."""
    cores = os.cpu_count() or 1
    return f"{_processor()}, {cores} core{'s' * (cores > 1)}, {platform.system()}"


def _processor() -> str:
    """Model of the processor, as far as the system tells."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = ""
    for line in text.splitlines():
        name, _, value = line.partition(":")
        if name.strip() == "model name" and value.strip():
            return value.strip()
    return platform.processor() or platform.machine() or "unknown processor"


@dataclass(frozen=True, kw_only=True)
class ComparisonAbout:
    """What a comparison was asked for.

    Attributes:
        task: Name of the task.
        algorithms: Names of the algorithms in the order of the tables; every other one is compared
            with the first.
        variants: Name of each domain file → what tells it apart (a path, a digest), in the order of
            the tables.
        base: Name of the variant that everything is reported of, model variants apart.
        trials: All that were asked for, complete or not.
        env_steps: Budget of each trial.
        seeds: Of the trials.
        threshold: Return from which a policy counts as good; None: there is none.
        evaluate_every: Env steps between evaluations of the learner alone.
        evaluation_episodes: Episodes of each of them.
        final_episodes: Episodes of the final evaluations.
        rewarded_by: Whose reward is learned from: `domain`, `environment` or `sum`.
        inputs: What the learners see, in words.
        command: What to type for the same comparison.
        unit: What a unit of the learning curve is called, such as `game`.
        notes: Sentences to be printed at the top.
        machine: What it ran on.
        versions: Package → version.
    """

    task: str
    algorithms: Sequence[str]
    variants: Mapping[str, str]
    base: str
    trials: Sequence[Trial]
    env_steps: int
    seeds: Sequence[int]
    threshold: float | None
    evaluate_every: int
    evaluation_episodes: int
    final_episodes: int | None = None
    rewarded_by: str
    inputs: str
    command: str
    unit: str = "unit"
    notes: Sequence[str] = ()
    machine: str = field(default_factory=machine)
    versions: Mapping[str, str] = field(default_factory=versions)
