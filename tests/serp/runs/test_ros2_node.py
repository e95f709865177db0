"""The ROS 2 node of the examples, with a stub of rclpy and of the messages."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

import serp
from serp.runs.evaluation import play
from tests.serp.runs.runs import without_pictures

NODE = Path(__file__).parents[3] / "docs" / "examples" / "ros2" / "policy_node.py"


class StubNode:
    """What the node uses of `rclpy.node.Node`."""

    policy = ""

    def __init__(self, name: str) -> None:
        self.published: dict[str, list[Any]] = {}
        self.logged: list[tuple[str, str]] = []
        self.callbacks: dict[str, Any] = {}

    def declare_parameter(self, name: str, default: str) -> SimpleNamespace:
        return SimpleNamespace(value={"policy": self.policy}[name])

    def get_logger(self) -> SimpleNamespace:
        return SimpleNamespace(
            info=lambda text: self.logged.append(("info", text)),
            error=lambda text: self.logged.append(("error", text)),
        )

    def create_publisher(self, kind: type, topic: str, depth: int) -> SimpleNamespace:
        sent = self.published.setdefault(topic, [])

        def publish(message: Any) -> None:
            assert isinstance(message, kind)
            sent.append(message.data)

        return SimpleNamespace(publish=publish)

    def create_subscription(self, kind: type, topic: str, callback: Any, depth: int) -> None:
        self.callbacks[topic] = callback


def message(name: str) -> type:
    return type(name, (SimpleNamespace,), {})


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> None:
    kinds = {name: message(name) for name in ("Float64MultiArray", "Int32", "String")}
    modules = {
        "rclpy": {},
        "rclpy.node": {"Node": StubNode},
        "std_msgs": {},
        "std_msgs.msg": kinds,
    }
    for name, contents in modules.items():
        module = ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name, module)


@without_pictures()
def test_the_node_publishes_the_action_of_the_run_and_its_reason(ros: None, tmp_path: Path) -> None:
    run = serp.plan_and_learn(
        "cartpole", preset="paper", episodes=2, out=tmp_path / "r", quiet=True
    )
    StubNode.policy = str(serp.export_policy(run, tmp_path / "policy"))
    spec = importlib.util.spec_from_file_location("policy_node", NODE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    node = module.PolicyNode()
    assert "agrees with" in node.logged[0][1]
    expected = []
    with run.environment() as task:
        for step in next(play(run.agent, task, episodes=1, seed=3)).steps:
            node.callbacks["observation"](SimpleNamespace(data=list(step.observation)))
            decision = step.decision
            name = task.actions.name(decision.action)
            expected.append((decision.action, f"{name}, {decision.executed_by}: {decision.reason}"))
    assert list(zip(*(node.published[t] for t in ("action", "reason")), strict=True)) == expected
    node.callbacks["observation"](SimpleNamespace(data=[0.0]))
    assert node.logged[-1][0] == "error" and len(node.published["action"]) == len(expected)
