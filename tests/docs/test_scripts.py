"""The scripts in `docs/examples`: they run, print what they say, and extend SErP as they say."""

from __future__ import annotations

import csv
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import serp
from serp.ui.root import serp as group
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


def test_the_domain_file_of_a_library_that_is_not_installed_loads() -> None:
    serp.load_domain(EXAMPLES / "highway" / "highway.pddl")


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
