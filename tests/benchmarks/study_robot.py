"""The tidying robot: hand-written controllers, SErP, and learners without a file.

    python -m tests.benchmarks.study_robot rules [--seeds 0-19]
    python -m tests.benchmarks.study_robot serp [--seeds 0-4] [--decisions 1000]
    python -m tests.benchmarks.study_robot worn [--seeds 0-4]
    python -m tests.benchmarks.study_robot speed

Each prints its rows of the table in docs/results/robot.md.
"""

import argparse
import time

import gymnasium
import numpy as np

from serp_envs.tidy import MACROS, THINGS, TidyRoom
from serp_adapters.tidy import ground, task

NAMES = list(MACROS)
ORDER = ("bottle", "glass", "block", "can")


def fluents(observation):
    """Return the fluents by name, as the domain file has them."""
    return dict(zip(FLUENTS, ground(observation).tolist(), strict=True))


with task().bind() as _bound:
    FLUENTS = [fluent.name for fluent in _bound.model.fluents]


def next_place(seen):
    """Return the action that is next in a plan: thing by thing, the drawer opened before."""
    held = next((name for name in THINGS if seen[f"held {name}"]), None)
    if held:
        shelf = THINGS[held].place == "shelf"
        if shelf:
            return "place-on-shelf" if seen["at shelf"] else "drive shelf"
        if seen["opening"] > 0.2:
            return "place-in-drawer" if seen["at drawer"] else "drive drawer"
        return "put-back" if seen["at table"] else "drive table"
    left = [name for name in ORDER if seen[f"on-table {name}"]]
    if not left:
        return "close-drawer" if seen["at drawer"] else "drive drawer"
    ahead = [name for name in left if seen[f"ahead {name}"]]
    name = ahead[0] if ahead else left[0]
    if THINGS[name].place == "drawer" and seen["opening"] <= 0.2:
        return "open-drawer" if seen["at drawer"] else "drive drawer"
    if not seen["at table"]:
        return "drive table"
    return f"grasp {name}" if seen[f"ahead {name}"] else f"approach {name}"


def greedy(seen):
    """The fastest way to the next point."""
    return next_place(seen).replace("drive", "rush")


def careful(seen):
    """Charge in time, rush where nobody is near and the glass is not held, wait for the person."""
    busy = any(seen[f"held {name}"] for name in THINGS)
    if seen["battery"] < 0.15 and not busy or seen["battery"] < 0.07:
        action = "charge" if seen["at charger"] else "drive charger"
    elif seen["at charger"] and seen["battery"] < 0.6:
        action = "charge"
    else:
        action = next_place(seen)
    if action.startswith("drive"):
        gap = seen["gap " + action.removeprefix("drive ")]
        if gap >= 1.8 and not seen["held glass"] and seen["battery"] > 0.3:
            return action.replace("drive", "rush")
    return action


def play(rule, seed, wear=0.0, log=None):
    """Return the return of an episode, its decisions, its last info."""
    env = gymnasium.make("serp_envs:serp/TidyRoom-v0", wear=wear)
    observation, info = env.reset(seed=seed)
    total, decisions, over = 0.0, 0, False
    while not over:
        action = rule(fluents(observation))
        observation, reward, terminated, truncated, info = env.step(NAMES.index(action))
        total, decisions, over = total + reward, decisions + 1, terminated or truncated
        if log:
            log(action, reward, info, fluents(observation))
    return total, decisions, info


if __name__ == "__main__":
    for wear in (0.0, 0.5):
        for rule in (greedy, careful):
            tries = {"n": 0, "ok": 0}
            def log(action, reward, info, seen):
                if action.startswith("grasp"):
                    tries["n"] += 1
                    tries["ok"] += seen["held " + action[6:]] > 0
            t = time.process_time()
            rows = [play(rule, s, wear, log) for s in range(15)]
            sec = sum(r[2]["seconds"] for r in rows)
            print(wear, rule.__name__, np.mean([r[0] for r in rows]).round(2), np.std([r[0] for r in rows]).round(2), "dec", np.mean([r[1] for r in rows]),
              "sec", sec/15, {k: sum(r[2][k] for r in rows) for k in ("hit","spilled","empty","dropped","tidied")}, tries, sec/(time.process_time()-t),"x")
