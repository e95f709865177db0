"""What a run was made with is read back as it was, or refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from serp.errors import RunError
from serp.runs.folder import RunFolder
from serp.runs.run import read_run_metadata
from serp.settings import resolve


def run(folder: Path, **changes: Any) -> RunFolder:
    config: dict[str, Any] = {
        "task": "corridor",
        "seed": 2**80,
        "reward": "domain",
        "control_period": 0.1,
        "max_ground_schemas": 50_000,
        "budget": {"episodes": None, "env_steps": 30, "units": None},
        "settings": resolve("default", None, {"training": {"random_steps": 1}}).as_dict(),
    }
    with RunFolder.create(folder / "run", {**config, **changes}, [("d.pddl", "(define)")]) as made:
        return made


@pytest.mark.parametrize(
    "changes",
    [
        {"seed": 1.5},
        {"control_period": 0},
        {"max_ground_schemas": 0},
        {"budget": {"episodes": 1.5, "env_steps": None, "units": None}},
        {"budget": None},
        {"settings": {"planner": 3}},
    ],
)
def test_what_does_not_fit_is_refused(tmp_path: Path, changes: dict[str, Any]) -> None:
    with pytest.raises(RunError, match=r"config\.json was changed or damaged: .+restore it"):
        read_run_metadata(run(tmp_path, **changes))
