"""A continuous control made discrete: Gymnasium's Pendulum with four controllers."""

from pathlib import Path

import gymnasium
import numpy as np

import serp
from serp_envs import MacroActions, option


def energy(seen):
    """Return kinetic plus potential energy by moment of inertia: 0 at rest on top."""
    return seen[2] ** 2 / 2 + 15 * (seen[0] - 1)


def lean(seen):
    """Return the angle from the vertical."""
    return np.arctan2(seen[1], seen[0])


def along(seen):
    """Return the largest torque, in the direction of the motion."""
    return np.array([2.0 if seen[2] >= 0 else -2.0])


def hold(seen):
    """Return the torque of a PD controller for the upright position."""
    return np.clip([-10 * lean(seen) - 2 * seen[2]], -2, 2)


OPTIONS = {
    "pump": option(along, steps=10, until=lambda seen: energy(seen) > -0.5),
    "brake": option(lambda seen: -along(seen), steps=10, until=lambda seen: energy(seen) < 0.5),
    "coast": option(lambda seen: np.zeros(1), steps=40, until=lambda seen: abs(lean(seen)) < 0.2),
    "balance": option(hold, steps=10),
}


def task() -> serp.Task:
    """Return the task; the options have the names of the actions in the domain file."""
    return serp.Task(
        make_env=lambda **how: MacroActions(gymnasium.make("Pendulum-v1", **how), OPTIONS),
        domain=Path(__file__).with_name("pendulum.pddl"),
        actions={name: number for number, name in enumerate(OPTIONS)},
        ground=lambda seen: {"energy": energy(seen), "lean": abs(lean(seen))},
        reward="environment",
    )


if __name__ == "__main__":
    run = serp.plan_and_learn(task(), env_steps=200, quiet=True)  # 200 options
    trained = run.evaluate("serp", episodes=10, quiet=True)
    print(trained.mean > -500)  # random torques: -1,200
# prints:
# True
