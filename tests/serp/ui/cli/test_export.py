"""`serp export`."""

from __future__ import annotations

from pathlib import Path

import serp
from tests.serp.ui.cli.conftest import Run


def test_a_policy_is_exported_once(run: Run, trained: Path, folder: Path) -> None:
    done = run("export", str(trained), "-o", "policy")
    assert "policy holds the policy" in done.stderr
    assert serp.Policy(folder / "policy").manifest["policy"].startswith("the learner's choice")
    again = run("export", str(trained), "-o", "policy", expect=1)
    assert "exists and is not empty" in again.stderr
