"""What a report says of a comparison beside its numbers."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from serp.comparison.folder import kept_file
from serp.comparison.plan import ComparisonPlan
from serp.comparison.prepared import PreparedComparison
from serp.comparison.request import default_threshold
from serp.model.facts import MAX_GROUND_SCHEMAS
from serp.runs.config import machine, versions
from serp.settings import Changes, resolve
from serp.tasks.bound_task import BoundTask
from serp.tasks.registry import task_entries
from serp.tasks.reward import reward_source


@dataclass(frozen=True, kw_only=True)
class ComparisonMetadata:
    """What a report says of a comparison beside its numbers.

    Attributes:
        plan: The plan; its algorithms and variants are in the order of the tables.
        rewarded_by: The source of the reward: `domain`, `environment` or `sum`.
        inputs: What learners see: `observation`, `state` (the grounded one) or `both`.
        command: The command that runs the same comparison again.
        notes: Sentences for the top of the report.
        machine: Description of the machine.
        versions: Package → version.
    """

    plan: ComparisonPlan
    rewarded_by: str
    inputs: str
    command: str
    notes: Sequence[str] = ()
    machine: Mapping[str, Any] = field(default_factory=machine)
    versions: Mapping[str, str | None] = field(default_factory=versions)


def metadata_of(
    prepared: PreparedComparison, bound: BoundTask, notes: Sequence[str]
) -> ComparisonMetadata:
    """Return the metadata of a planned comparison."""
    settings = resolve("default", bound.task.settings, prepared.plan.changes)
    return ComparisonMetadata(
        plan=prepared.plan,
        rewarded_by=reward_source(bound.rewarded_by, settings),
        inputs=settings.training.inputs,
        command=rerun_command(prepared, default_threshold(bound)),
        notes=notes,
    )


def rerun_command(prepared: PreparedComparison, threshold: float | None) -> str:
    """Return the command that repeats the comparison with its copies of the domain files.

    Paths are relative to its folder. For a task that is not installed the command has a
    placeholder.
    """
    plan, protocol = prepared.plan, prepared.plan.protocol
    files = (kept_file(prepared.folder, name) for name in plan.variants)
    base, *others = (file.relative_to(prepared.folder).as_posix() for file in files)
    words = ["--domain", base]
    if plan.task not in task_entries():
        words += ["--task", "FILE.py:FUNCTION"]
    words += ["--algorithms", ",".join(plan.algorithms), "--seeds", _seeds(plan.seeds)]
    for name in ("env_steps", "evaluate_every", "evaluation_episodes", "final_episodes"):
        words += [f"--{name.replace('_', '-')}", str(getattr(protocol, name))]
    if plan.threshold != threshold:
        words += ["--threshold", str(plan.threshold)]
    if plan.max_ground_schemas != MAX_GROUND_SCHEMAS:
        words += ["--max-ground-schemas", str(plan.max_ground_schemas)]
    for file in others:
        words += ["--model-variants", file]
    for setting in _assignments(plan.changes):
        words += ["--set", setting]
    return shlex.join(["serp", "compare", *words, "--out", "again"])


def _seeds(seeds: Sequence[int]) -> str:
    if all(b == a + 1 for a, b in pairwise(seeds)):  # a single number would mean a count
        return f"{seeds[0]}-{seeds[-1]}"
    return ",".join(map(str, seeds))


def _assignments(changes: Changes) -> Iterator[str]:
    """Yield settings in the form of the command line."""
    for section, values in changes.items():
        for name, value in values.items():
            json_like = value is None or isinstance(value, bool | tuple)
            yield f"{section}.{name}={json.dumps(value) if json_like else value}"
