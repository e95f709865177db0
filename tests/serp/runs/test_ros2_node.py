"""The ROS 2 node of the examples, with stubs of rclpy and of the messages."""

import runpy
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

import serp
from serp.runs.evaluation import play
from tests.serp.runs.runs import without_pictures

NODE = Path(__file__).parents[3] / "docs" / "examples" / "ros2" / "policy_node.py"


@without_pictures()
def test_the_node_publishes_the_action_of_the_run_and_its_reason(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    run = serp.plan_and_learn(
        "cartpole", preset="paper", episodes=2, out=tmp_path / "r", quiet=True
    )
    policy = serp.export_policy(run, tmp_path / "policy")
    logger, published = Mock(), {"action": Mock(), "reason": Mock()}

    class StubNode:
        def __init__(self, name: str) -> None: ...

        def create_subscription(self, *given: Any) -> None: ...

        def get_logger(self) -> Mock:
            return logger

        def declare_parameter(self, name: str, default: str) -> Any:
            return SimpleNamespace(value=str(policy))

        def create_publisher(self, kind: type, topic: str, depth: int) -> Mock:
            return published[topic]

    monkeypatch.setitem(sys.modules, "rclpy", Mock())
    monkeypatch.setitem(sys.modules, "rclpy.node", Mock(Node=StubNode))
    messages = dict.fromkeys(("Float64MultiArray", "Int32", "String"), SimpleNamespace)
    monkeypatch.setitem(sys.modules, "std_msgs", Mock())
    monkeypatch.setitem(sys.modules, "std_msgs.msg", Mock(**messages))
    node = runpy.run_path(str(NODE))["PolicyNode"]()
    assert "agrees with" in logger.info.call_args.args[0]
    with run.environment() as task:
        for step in next(play(run.agent, task, episodes=1, seed=3)).steps:
            node.act(SimpleNamespace(data=list(step.observation)))
            decision = step.decision
            reason = f"{task.actions.name(decision.action)}, {decision.executed_by}: "
            sent = [published[topic].publish.call_args.args[0].data for topic in published]
            assert sent == [decision.action, reason + decision.reason]
    answers = published["action"].publish.call_count
    node.act(SimpleNamespace(data=[0.0]))
    assert logger.error.called and published["action"].publish.call_count == answers
