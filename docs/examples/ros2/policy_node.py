"""A ROS 2 node that acts by an exported policy.

It subscribes to `observation` (std_msgs/Float64MultiArray) and publishes `action` (std_msgs/Int32),
the number of the environment action, and `reason` (std_msgs/String), for people and logs:

    serp export runs/first -o policy
    python3 policy_node.py --ros-args -p policy:=policy

Write your grounding into `ground`; the node does not start if it differs from the recorded pairs.
"""

import rclpy
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray, Int32, String

import serp


def ground(observation):
    """Return the numbers of the state, in the order of `policy.fluents`, for an observation."""
    return observation


class PolicyNode(Node):
    """Answers every observation with an action."""

    def __init__(self) -> None:
        super().__init__("serp_policy")
        folder = self.declare_parameter("policy", "policy").value
        self.policy = serp.Policy(folder, ground=ground)
        pairs = self.policy.check_grounding(ground)
        self.get_logger().info(f"{folder}: the grounding agrees with {pairs} recorded pairs")
        self._actions = self.create_publisher(Int32, "action", 1)
        self._reasons = self.create_publisher(String, "reason", 1)
        # Depth 1: a robot acts on the newest observation, not on those it has missed.
        self.create_subscription(Float64MultiArray, "observation", self.act, 1)

    def act(self, message) -> None:
        """Publish the action for an observation; none for one that cannot be used."""
        try:
            decision = self.policy.decide(message.data)
        except serp.SerpError as error:
            self.get_logger().error(f"no action: {error}")
            return
        self._actions.publish(Int32(data=decision.action))
        said = f"{self.policy.actions[decision.action]}, {decision.executed_by}: {decision.reason}"
        self._reasons.publish(String(data=said))


def main() -> None:
    """Run the node until it is stopped."""
    rclpy.init()
    node = PolicyNode()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
