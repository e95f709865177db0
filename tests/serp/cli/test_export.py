"""`serp export`."""

from __future__ import annotations

from pathlib import Path

from serp.controller import Controller
from tests.serp.cli.conftest import Run


def test_a_policy_is_exported_once(run: Run, trained: Path, folder: Path) -> None:
    done = run("export", str(trained), "-o", "policy")
    assert done.exit_code == 0 and "policy holds the policy" in done.stderr
    assert Controller(folder / "policy").manifest["policy"].startswith("the learner's choice")
    again = run("export", str(trained), "-o", "policy")
    assert again.exit_code == 1 and "exists and is not empty" in again.stderr
