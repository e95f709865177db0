"""An exported policy decides as the run does; damaged folders are refused."""

import json
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

import serp
from serp.errors import RunError, SerpError
from serp.runs import checkpoint
from serp.runs.checkpoint import CHECKPOINT
from serp.runs.diagnosis.diagnosis import diagnose
from serp.runs.evaluation import play
from serp.runs.run import Run
from serp.runs.run_config import CONFIG

STEPS = {"cartpole": 400, "soccer": 300, "taxi": 300, "tea": 200}
EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"


@pytest.fixture(scope="module", params=[*STEPS])
def run(request, tmp_path_factory):
    task, path = str(request.param), tmp_path_factory.mktemp("run") / "run"
    played = serp.file_task(EXAMPLES / "tea.pddl") if task == "tea" else task
    return serp.plan_and_learn(played, env_steps=STEPS[task], out=path, quiet=True, seed=1)


@pytest.fixture(scope="module")
def cartpole_run(tmp_path_factory):
    out = tmp_path_factory.mktemp("cartpole") / "run"
    return serp.plan_and_learn("cartpole", preset="paper", episodes=2, out=out, quiet=True)


@pytest.fixture(scope="module")
def cartpole(cartpole_run, tmp_path_factory):
    return serp.export_policy(cartpole_run, tmp_path_factory.mktemp("cartpole") / "policy")


def test_what_a_run_plays_is_decided_alike(run, tmp_path):
    folder = serp.export_policy(run, tmp_path / "policy")
    policy, grounded = serp.Policy(folder), serp.Policy(folder, ground=run.task.ground)
    with run.environment() as task:
        for step in next(play(run.agent, task, episodes=1, seed=3)):
            given = policy.decide(step.observation, state=task.model.values(step.state))
            for decision in (given, grounded.decide(step.observation)):
                assert decision.action == step.decision.action
                assert decision.reason == step.decision.reason


def test_an_exported_policy_is_evaluated_as_the_run_is(cartpole_run, cartpole):
    exported = serp.load_run(cartpole)
    assert exported.evaluate(episodes=3).returns == cartpole_run.evaluate(episodes=3).returns
    assert diagnose(cartpole).verdict == diagnose(cartpole_run.path).verdict
    with pytest.raises(RunError, match="is an exported policy"):
        serp.plan_and_learn("cartpole", out=cartpole, resume=True)


def test_equal_runs_are_exported_to_equal_folders(run, tmp_path):
    one, other = (serp.export_policy(run.path, tmp_path / name) for name in "ab")
    for file in one.iterdir():
        assert file.read_bytes() == (other / file.name).read_bytes()


def test_an_export_that_fails_leaves_nothing_in_its_way(cartpole_run, tmp_path, monkeypatch):
    with monkeypatch.context() as patch, pytest.raises(RunError, match="cannot write"):
        patch.setattr("os.replace", Mock(side_effect=OSError("the disk is full")))
        serp.export_policy(cartpole_run, tmp_path / "policy")
    assert serp.export_policy(cartpole_run, tmp_path / "policy").is_dir()


def test_a_robot_decides_without_libraries_for_learning_drawing_or_a_terminal(cartpole):
    script = (
        "import json, sys, serp; policy = serp.Policy(sys.argv[1])\n"
        "policy.decide([0.1] * 4, state=[0.1] * 4); print(json.dumps(list(sys.modules)))"
    )
    command = [sys.executable, "-c", script, str(cartpole)]
    loaded = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    assert "serp.runs.policy" in loaded
    assert {"click", "matplotlib", "networkx", "onnx", "rich", "scipy", "torch"}.isdisjoint(loaded)


def test_a_grounding_is_checked_by_recorded_pairs(cartpole):
    policy = serp.Policy(cartpole)
    assert 1 < policy.check_grounding(lambda observation: observation) <= 32
    with pytest.raises(RunError, match="`cart-position`"):
        policy.check_grounding(lambda observation: observation + 1.0)
    with pytest.raises(RunError, match="`cart-position`"):
        serp.Policy(cartpole, ground=lambda observation: observation + 1.0)
    for observation, state in (([0.0], [0.0] * 4), ([0.0] * 4, {"pole-angle": 0.0})):
        with pytest.raises(SerpError, match="expected 4 for Box|no value for fluent"):
            policy.decide(observation, state=state)


@pytest.mark.parametrize(
    "changes",
    [
        {"actions": []},
        {"observation_space": {"Box": {"shape": [3], "dtype": "float32"}}},
        {"ground_actions": [[5], [1]]},
        {"ground_actions": {}},
    ],
    ids=str,
)
def test_a_wrong_configuration_with_a_right_digest_is_refused(changes, cartpole, tmp_path):
    folder = shutil.copytree(cartpole, tmp_path / "policy")
    whole = json.loads((folder / CONFIG).read_text())
    whole["config"]["policy"] |= changes
    (folder / CONFIG).write_text(json.dumps(whole))
    with pytest.raises(RunError, match=r"config\.json of the run was changed"):
        serp.Policy(folder)
    arrays, meta = checkpoint.load(folder / CHECKPOINT)
    meta["made_of"] = Run(folder).digests()
    checkpoint.save(folder / CHECKPOINT, arrays, meta)
    with pytest.raises(RunError):
        serp.Policy(folder)


def test_a_run_that_was_not_exported_is_refused(cartpole_run):
    with pytest.raises(RunError, match="is not what `serp export` wrote"):
        serp.Policy(cartpole_run.path)


@pytest.mark.parametrize("name", [CHECKPOINT, "domain.pddl"])
def test_a_changed_file_is_refused(name, cartpole, tmp_path):
    folder = shutil.copytree(cartpole, tmp_path / "policy")
    (folder / name).write_bytes((folder / name).read_bytes()[:-1])
    with pytest.raises(RunError, match="is damaged|was changed after"):
        serp.Policy(folder)
    (folder / name).unlink()
    with pytest.raises(RunError, match="cannot read|there is no"):
        serp.Policy(folder)


def test_the_ros_2_node_publishes_the_action_of_the_run_and_its_reason(
    cartpole_run, cartpole, monkeypatch
):
    """The node of the examples, with stubs of rclpy and of the messages."""
    logger, published = Mock(), {"action": Mock(), "reason": Mock()}

    class StubNode:
        def __init__(self, name): ...

        def create_subscription(self, *given): ...

        def get_logger(self):
            return logger

        def declare_parameter(self, name, default):
            return SimpleNamespace(value=str(cartpole))

        def create_publisher(self, kind, topic, depth):
            return published[topic]

    monkeypatch.setitem(sys.modules, "rclpy", Mock())
    monkeypatch.setitem(sys.modules, "rclpy.node", Mock(Node=StubNode))
    messages = dict.fromkeys(("Float64MultiArray", "Int32", "String"), SimpleNamespace)
    monkeypatch.setitem(sys.modules, "std_msgs", Mock())
    monkeypatch.setitem(sys.modules, "std_msgs.msg", Mock(**messages))
    node = runpy.run_path(str(EXAMPLES / "ros2" / "policy_node.py"))["PolicyNode"]()
    assert "agrees with" in logger.info.call_args.args[0]
    with cartpole_run.environment() as task:
        for step in next(play(cartpole_run.agent, task, episodes=1, seed=3)):
            node.act(SimpleNamespace(data=list(step.observation)))
            decision = step.decision
            reason = f"{task.actions.name(decision.action)}, {decision.executed_by}: "
            sent = [published[topic].publish.call_args.args[0].data for topic in published]
            assert sent == [decision.action, reason + decision.reason]
    answers = published["action"].publish.call_count
    node.act(SimpleNamespace(data=[0.0]))
    assert logger.error.called and published["action"].publish.call_count == answers
