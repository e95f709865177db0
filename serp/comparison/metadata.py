"""The metadata of a comparison: request, command, machine and versions."""

from __future__ import annotations

import json
import os
import platform
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from itertools import pairwise
from pathlib import Path
from typing import Final

from serp.comparison.algorithms import Changes
from serp.comparison.folder import kept_file
from serp.comparison.plan import ComparisonPlan
from serp.comparison.protocol import ComparisonProtocol
from serp.comparison.request import default_threshold
from serp.comparison.trial_records import Trial
from serp.comparison.trials.trial import unit_of
from serp.model.facts import MAX_GROUND_SCHEMAS
from serp.settings import resolve
from serp.tasks.bound_task import BoundTask
from serp.tasks.registry import task_entries
from serp.tasks.reward import reward_source

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
    """Return the version of Python and of each installed package that results depend on."""
    found = {"Python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def machine() -> str:
    """Return the kind of machine: processor, cores, operating system."""
    cores = os.cpu_count() or 1
    return f"{_processor()}, {cores} core{'s' * (cores > 1)}, {platform.system()}"


def _processor() -> str:
    """Return the model of the processor, as far as the system names it."""
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
class ComparisonMetadata:
    """The metadata of a comparison.

    Attributes:
        task: Name of the task.
        algorithms: Names of the algorithms in the order of the tables; the others are compared with
            the first.
        variants: Name of each domain file → its path in the folder, in the order of the tables.
        base: Name of the variant of all results, except those on model variants.
        trials: All requested trials, complete or not.
        protocol: Budget and evaluations.
        threshold: Return from which a policy counts as good; None for none.
        rewarded_by: The source of the reward: `domain`, `environment` or `sum`.
        inputs: Description of the learners' input.
        command: The command that runs the same comparison again.
        unit: Name of the unit of the learning curve, such as `game`.
        notes: Sentences for the top of the report.
        machine: Description of the machine.
        versions: Package → version.
    """

    task: str
    algorithms: Sequence[str]
    variants: Mapping[str, str]
    base: str
    trials: Sequence[Trial]
    protocol: ComparisonProtocol
    threshold: float | None
    rewarded_by: str
    inputs: str
    command: str
    unit: str = "unit"
    notes: Sequence[str] = ()
    machine: str = field(default_factory=machine)
    versions: Mapping[str, str] = field(default_factory=versions)

    @property
    def seeds(self) -> list[int]:
        """All seeds, in ascending order."""
        return sorted({trial.seed for trial in self.trials})


_INPUTS: Final = {
    "observation": "the observation",
    "state": "the grounded state",
    "both": "the observation and the grounded state",
}


def metadata_of(plan: ComparisonPlan, bound: BoundTask, notes: Sequence[str]) -> ComparisonMetadata:
    """Return the metadata of a planned comparison."""
    settings = resolve("default", bound.task.settings, plan.changes)
    return ComparisonMetadata(
        task=plan.task,
        algorithms=list(plan.algorithms),
        variants={name: _inside(plan, name) for name in plan.variants},
        base=plan.base,
        trials=plan.trials,
        protocol=plan.protocol,
        threshold=plan.threshold,
        rewarded_by=reward_source(bound.rewarded_by, settings),
        inputs=_INPUTS[settings.training.inputs],
        command=rerun_command(plan, default_threshold(bound)),
        unit=unit_of(bound.task),
        notes=notes,
    )


def rerun_command(plan: ComparisonPlan, threshold: float | None) -> str:
    """Return the command that repeats the comparison with its copies of the domain files.

    Paths are relative to its folder. For a task that is not installed the command has a
    placeholder.

    Args:
        plan: The comparison.
        threshold: The default of its threshold.
    """
    protocol = plan.protocol
    base, *others = (_inside(plan, name) for name in plan.variants)
    words = ["serp", "compare", "--domain", base]
    if plan.task not in task_entries():
        words += ["--task", "FILE.py:FUNCTION"]
    words += ["--algorithms", ",".join(plan.algorithms)]
    words += ["--seeds", _seeds(plan.seeds), "--env-steps", str(protocol.env_steps)]
    words += ["--evaluate-every", str(protocol.evaluate_every)]
    words += ["--evaluation-episodes", str(protocol.evaluation_episodes)]
    words += ["--final-episodes", str(protocol.final_episodes)]
    if plan.threshold != threshold:
        words += ["--threshold", str(plan.threshold)]
    if plan.max_ground_schemas != MAX_GROUND_SCHEMAS:
        words += ["--max-ground-schemas", str(plan.max_ground_schemas)]
    for file in others:
        words += ["--model-variants", file]
    for setting in _assignments(plan.changes):
        words += ["--set", setting]
    return shlex.join([*words, "--out", "again"])


def _inside(plan: ComparisonPlan, variant: str) -> str:
    """Return the path of a kept domain file in the folder of the comparison."""
    return kept_file(plan.folder, variant).relative_to(plan.folder).as_posix()


def _seeds(seeds: Sequence[int]) -> str:
    if all(b == a + 1 for a, b in pairwise(seeds)):  # a single number would mean a count
        return f"{seeds[0]}-{seeds[-1]}"
    return ",".join(map(str, seeds))


def _assignments(changes: Changes) -> Iterator[str]:
    """Yield settings in the form of the command line."""
    for section, values in changes.items():
        for name, value in values.items():
            json_like = value is None or isinstance(value, bool | tuple | list)
            yield f"{section}.{name}={json.dumps(value) if json_like else value}"
