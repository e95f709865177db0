"""An environment of your own: Gymnasium's CliffWalking with the domain file walkway.pddl."""

from pathlib import Path

import gymnasium

import serp


def task() -> serp.Task:
    """Return environment, domain file and grounding."""
    return serp.Task(
        make_env=lambda: gymnasium.make("CliffWalking-v1", max_episode_steps=200),
        domain=Path(__file__).with_name("walkway.pddl"),
        ground=lambda cell: {"row": cell // 12, "column": cell % 12},
    )


if __name__ == "__main__":
    run = serp.plan_and_learn(task(), env_steps=3_000)
    print(run.evaluate("serp", episodes=5).mean)  # the return; -13 is the best there is
    print(run.summary["unsafe_executed"])  # falls, exploration included
    print(run.decide(24).action)  # decide for one observation: 1 is east
# prints:
# -13.0
# 0
# 1
