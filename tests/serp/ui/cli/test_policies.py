"""`serp evaluate`, `serp export` and `serp watch`: what is done with a trained policy."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import serp
from serp.agent.agent import account_of
from serp.errors import Notice
from serp.runs.recording import EVALUATIONS, open_recording
from serp.runs.run import load_run
from tests.serp.ui.cli.conftest import Run


def measured(run: Run, *arguments: str) -> Any:
    return json.loads(run("evaluate", *arguments, "--json").stdout)


@pytest.mark.parametrize("policy", ["serp", "planner"])
def test_json_is_what_the_evaluation_gives(policy: Any, run: Run, trained: Path) -> None:
    shown = measured(run, str(trained), f"--policy={policy}", "--episodes=2", "--seed=9")
    result = load_run(trained).evaluate(policy, episodes=2, seed=9)
    said = account_of(load_run(trained).agent)
    assert said == {name: load_run(trained).summary[name] for name in said}
    assert shown == {"run": str(trained), "seed": 9, **result.as_dict(), **said}
    assert shown["mean"] == np.mean(shown["returns"])
    recorded = open_recording(trained, f"{policy}-seed9")
    assert [len(steps) for steps in recorded.episodes.values()] == shown["lengths"]
    assert recorded.columns("env_reward")["env_reward"].sum() == sum(shown["returns"])


def test_where_nothing_can_be_recorded_it_is_measured_all_the_same(
    run: Run, trained: Path, tmp_path: Path
) -> None:
    kept = tmp_path / "kept"
    shutil.copytree(trained, kept, ignore=shutil.ignore_patterns(EVALUATIONS))
    (kept / EVALUATIONS).write_text("a file")
    with pytest.warns(Notice, match="the episodes are not recorded"):
        assert measured(run, str(kept), "--episodes=1")["episodes"] == 1


def test_a_policy_is_exported_once(run: Run, trained: Path, folder: Path) -> None:
    done = run("export", str(trained), "-o", "policy")
    assert "policy holds the policy" in done.stderr
    assert serp.Policy(folder / "policy").manifest["policy"].startswith("the learner's choice")
    again = run("export", str(trained), "-o", "policy", expect=1)
    assert "exists and is not empty" in again.stderr
