"""The command that does a comparison again."""

from __future__ import annotations

import json
import shlex
from itertools import pairwise
from typing import Any

from serp.compare.algorithms import Changes
from serp.compare.plan import ComparisonPlan, kept_file
from serp.tasks.registry import task_entries


def command(plan: ComparisonPlan) -> str:
    """Return the command that begins the comparison anew, with the domain files as it keeps them.

    Files are named from within its folder. Of a task that is not installed, nothing says where it
    lies: that is left to be filled in.
    """
    conditions = plan.conditions
    base, *others = (
        kept_file(plan.folder, name).relative_to(plan.folder).as_posix() for name in plan.variants
    )
    words = ["serp", "compare", "--domain", base]
    if plan.name not in task_entries():
        words += ["--task", "FILE.py:FUNCTION"]
    words += ["--algorithms", ",".join(plan.algorithms)]
    words += ["--seeds", _seeds(plan.seeds), "--env-steps", str(conditions.env_steps)]
    words += ["--evaluate-every", str(conditions.evaluate_every)]
    words += ["--evaluation-episodes", str(conditions.evaluation_episodes)]
    words += ["--final-episodes", str(conditions.final_episodes)]
    for file in others:
        words += ["--model-variants", file]
    for setting in _assignments(plan.changes):
        words += ["--set", setting]
    return shlex.join([*words, "--out", "again"])


def _seeds(seeds: list[int]) -> str:
    if all(b == a + 1 for a, b in pairwise(seeds)):  # a single number would be how many
        return f"{seeds[0]}-{seeds[-1]}"
    return ",".join(map(str, seeds))


def _assignments(changes: Changes) -> list[str]:
    return [
        f"{section}.{name}={_text(value)}"
        for section, values in changes.items()
        for name, value in values.items()
    ]


def _text(value: Any) -> str:
    """Return a value as it is typed."""
    if value is None or isinstance(value, bool | tuple | list):
        return json.dumps(value)
    return str(value)
