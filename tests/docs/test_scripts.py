"""The scripts in `docs/examples`: they run, print what they say, and extend SErP as they say."""

from __future__ import annotations

import csv
import importlib.util
import os
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import serp
from serp.ui.main import serp as group
from tests.docs.pages import EXAMPLES
from tests.serp.runs.runs import without_pictures


@pytest.mark.parametrize("script", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_example_scripts_run(
    script: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    with without_pictures():
        runpy.run_path(str(script), run_name="__main__")
    printed = capsys.readouterr().out
    shown = re.findall(r"^# prints:\n((?:# .*\n)+)", script.read_text(encoding="utf-8"), re.M)
    assert printed if not shown else printed == re.sub(r"^# ", "", shown[0], flags=re.M)


@pytest.mark.parametrize(
    ("library", "script"),
    [
        ("highway_env", "highway/highway.py"),
        ("mlflow", "logging/mlflow_run.py"),
        ("wandb", "logging/wandb_run.py"),
    ],
)
def test_examples_of_other_libraries_run_where_these_are(
    library: str, script: str, tmp_path: Path
) -> None:
    for file in (EXAMPLES / script).parent.glob("*.pddl"):
        serp.load_domain(file)
    if importlib.util.find_spec(library) is None:
        pytest.skip(f"{library} is not installed")
    subprocess.run(
        [sys.executable, EXAMPLES / script],
        cwd=tmp_path, env={**os.environ, "WANDB_MODE": "offline"}, check=True, timeout=300,
    )  # fmt: skip


def test_the_parts_of_the_hierarchical_task_fit_together() -> None:
    defence = runpy.run_path(str(EXAMPLES / "defence" / "defence.py"))
    options = dict.fromkeys(("approach", "contest"))
    for task in (defence["approach"](), defence["contest"](None), defence["defence"](options)):
        with task.bind() as bound:
            bound.reset(seed=0)


def test_an_extension_is_found_by_its_entry_points(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    source = shutil.copytree(EXAMPLES / "extension", tmp_path / "source")
    where = ["--no-build-isolation", "--target", str(tmp_path / "site"), str(source)]
    subprocess.run([*pip, *where], check=True, timeout=120)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path / "site")
    monkeypatch.setitem(sys.modules, "my_extension", None)  # so that it is absent in the end
    del sys.modules["my_extension"]
    names = ["guide.strategy=planner-first", "learner.learning_starts=40", "planner.name=one-step"]
    words = ["plan-and-learn", "--domain=cartpole", "--env-steps=80", "--out=run", "--quiet"]
    with pytest.raises(SystemExit) as end, without_pictures():
        group(
            [*words, *(f"--set={name}" for name in [*names, "learner.name=table"])],
            prog_name="serp",
        )
    assert end.value.code == 0
    with (tmp_path / "run" / "decisions.csv").open(newline="", encoding="utf-8") as file:
        proposed = [row["proposed_by"] for row in csv.DictReader(file)]
    assert set(proposed[:40]) == {"planner"}
    assert set(proposed[41:]) <= {"learner", "exploration"}


def test_the_learner_of_the_extension_learns_and_continues_exactly() -> None:
    spec = importlib.util.spec_from_file_location("e", EXAMPLES / "extension" / "my_extension.py")
    assert spec is not None and spec.loader is not None
    extension = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(extension)

    def walked(learner: Any, steps: int) -> list[int]:
        """Walk along five cells, with a reward at the right end."""
        at, chosen = 0, []
        for _ in range(steps):
            action = learner.propose(np.array([at]), None).action
            to = max(0, at + (1 if action else -1))
            learner.remember(np.array([at]), action, float(to == 4), np.array([to]), to == 4, False)
            at = 0 if to == 4 else to
            chosen.append(action)
        return chosen

    settings = serp.LearnerSettings(epsilon_end=0.2, epsilon_steps=200)
    learner = extension.Table(1, 2, settings, 0)
    walked(learner, 400)
    again = extension.Table(1, 2, settings, 9)
    again.load_state_dict(*learner.state_dict())
    assert walked(again, 50) == walked(learner, 50)
    assert [learner.propose_greedily(np.array([at])).action for at in range(4)] == [1] * 4
