"""Driving on a motorway: highway-env's actions with the domain file highway.pddl."""

from pathlib import Path

import gymnasium
import highway_env  # noqa: F401 (registers the environments)

import serp


def ground(seen):
    """Return the values of the fluents.

    Each row of the observation is a car, ours first, the others relative to it: presence, position
    along the road in 200 m and across it in 12 m (three lanes of 4 m), velocities in 80 m/s.
    """
    lane = round(seen[0, 2] * 3)
    state = {"our-lane": lane, "speed": seen[0, 3] * 80}
    for number, name in enumerate(("left", "middle", "right")):
        gap, closing = 100.0, 0.0
        for presence, x, y, vx, _ in seen[1:]:
            if presence and round(lane + y * 3) == number and -10 < x * 200 < gap:
                gap, closing = x * 200, -vx * 80
        state[f"gap {name}"], state[f"closing {name}"] = gap, closing
    return state


def task() -> serp.Task:
    """Return environment, domain file and grounding."""
    return serp.Task(
        make_env=lambda **how: gymnasium.make("highway-fast-v0", **how),
        domain=Path(__file__).with_name("highway.pddl"),
        ground=ground,
        reward="environment",
    )


if __name__ == "__main__":
    run = serp.plan_and_learn(task(), env_steps=600)
    print(run.evaluate("serp", episodes=20).mean)
