"""`serp evaluate`, `serp export` and `serp watch`: what is done with a trained policy."""

import json

import numpy as np
import pytest

import serp
from serp.agent.agent import account_of
from serp.runs.recording import open_recording
from serp.runs.run import load_run


def measured(run, *arguments):
    return json.loads(run("evaluate", *arguments, "--json").stdout)


@pytest.mark.parametrize("policy", ["serp", "planner"])
def test_json_is_what_the_evaluation_gives(policy, run, trained):
    shown = measured(run, str(trained), f"--policy={policy}", "--episodes=2", "--seed=9")
    result = load_run(trained).evaluate(policy, episodes=2, seed=9)
    said = account_of(load_run(trained).agent)
    assert said == {name: load_run(trained).summary[name] for name in said}
    assert shown == {"run": str(trained), "seed": 9, **result.as_dict(), **said}
    assert shown["mean"] == np.mean(shown["returns"])
    recorded = open_recording(trained, f"{policy}-seed9")
    assert [len(steps) for steps in recorded.episodes.values()] == shown["lengths"]
    assert recorded.columns("env_reward")["env_reward"].sum() == sum(shown["returns"])


def test_a_policy_is_exported_once(run, trained, folder):
    done = run("export", str(trained), "-o", "policy")
    assert "policy holds the policy" in done.stderr
    assert serp.Policy(folder / "policy").about["choice"].startswith("the learner's choice")
    again = run("export", str(trained), "-o", "policy", expect=1)
    assert "already holds a run" in again.stderr
