"""The tidying robot: hand-written controllers, SErP's training, a gripper that wears, the physics.

    python -m tests.benchmarks.study_robot rules [--seeds 0-19] [--wear 0]
    python -m tests.benchmarks.study_robot serp [--seeds 0-4] [--decisions 1000]
    python -m tests.benchmarks.study_robot speed

`rules` prints what two controllers reach. `serp` prints for each seed the first episode, the
policy after the training (10 episodes), and what happened to the file's flags; then the gripper
wears so that 36 % of the careful controller's grasps slip instead of 21 % (`rules --wear 0.1`),
and the returns of the next 10 episodes follow. Learners without a file are compared by

    serp compare --domain tidy --algorithms dqn,sb3-dqn,ppo --env-steps 3000 --seeds 3
"""

import argparse
import time

import gymnasium
import numpy as np

from serp.runs.trainer import Trainer
from serp.settings import resolve
from serp_adapters.tidy import ground, task
from serp_envs.tidy import MACROS, THINGS
from tests.benchmarks.ladder import played

WORN = 0.1
"""Share of its friction that the gripper loses in mid-run."""
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
    if seen["battery"] < (0.07 if busy else 0.15):
        action = "charge" if seen["at charger"] else "drive charger"
    elif seen["at charger"] and seen["battery"] < 0.6:
        action = "charge"
    else:
        action = next_place(seen)
    if action.startswith("drive"):
        gap = seen["gap " + action.removeprefix("drive ")]
        if gap >= 2.0 and not seen["held glass"] and seen["battery"] > 0.3:
            return action.replace("drive", "rush")
    return action


def play(rule, seed, wear=0.0):
    """Return the return of an episode, its decisions, its last info, grasps and slips."""
    env = gymnasium.make("serp_envs:serp/TidyRoom-v0", wear=wear)
    observation, info = env.reset(seed=seed)
    total, decisions, grasps, slips, over = 0.0, 0, 0, 0, False
    while not over:
        action = rule(fluents(observation))
        observation, reward, terminated, truncated, info = env.step(NAMES.index(action))
        total, decisions, over = total + reward, decisions + 1, terminated or truncated
        if action.startswith("grasp"):
            grasps += 1
            slips += not fluents(observation)[action.replace("grasp", "held")]
    return total, decisions, info, grasps, slips


def rules(seeds, wear):
    """Print the controllers."""
    for rule in (greedy, careful):
        rows = [play(rule, seed, wear) for seed in seeds]
        returns = np.array([row[0] for row in rows])
        broken = sum(row[2]["unsafe"] for row in rows)
        print(
            f"{rule.__name__}, wear {wear}: return {returns.mean():.2f} ± {returns.std():.2f}, "
            f"{np.mean([row[1] for row in rows]):.1f} decisions, damage in {broken} of {len(rows)} "
            f"episodes, slips {sum(r[4] for r in rows)} of {sum(r[3] for r in rows)} grasps",
            flush=True,
        )


def train(seed, decisions):
    """Train, wear the gripper, go on; print a line."""
    begun = time.process_time()
    bound, rows = task().bind(), []
    with bound, Trainer(bound, resolve("default", bound.task.settings), seed) as trainer:
        while trainer.env_steps < decisions:
            rows.append(next(trainer.run()))
        after = [one.return_ for one in played(bound, trainer.agent, 10_000 * (seed + 1), 10)]
        spent = time.process_time() - begun
        bound.env.unwrapped.wear = WORN
        worn = [next(trainer.run()) for _ in range(10)]
    every = rows + worn
    print(
        f"seed {seed}: first episode {rows[0].return_:.2f}, next four "
        f"{np.mean([row.return_ for row in rows[1:5]]):.2f}, policy {np.mean(after):.2f} ± "
        f"{np.std(after):.2f} ({min(after):.2f} at least), {len(rows)} episodes; flagged and "
        f"executed with an alternative {sum(row.avoidable_unsafe for row in every)}, flagged and "
        f"executed {sum(row.unsafe_executed for row in every)}, vetoes "
        f"{sum(row.vetoes for row in every)}, damage observed "
        f"{sum(row.unsafe_observed for row in every)}; worn: "
        f"{' '.join(f'{row.return_:.2f}' for row in worn)}; {spent:.0f} s of CPU",
        flush=True,
    )


def speed():
    """Print how many times faster than real time a careful episode is, in CPU seconds."""
    begun = time.process_time()
    seconds = sum(play(careful, seed)[2]["seconds"] for seed in range(4))
    print(f"physics with controllers: {seconds / (time.process_time() - begun):.0f} × real time")


def main():
    """Run a part."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("part", choices=("rules", "serp", "speed"))
    parser.add_argument("--seeds", help="first-last")
    parser.add_argument("--decisions", type=int, default=1_000)
    parser.add_argument("--wear", type=float, default=0.0)
    options = parser.parse_args()
    first, _, last = (options.seeds or {"rules": "0-19"}.get(options.part, "0-4")).partition("-")
    seeds = range(int(first), int(last or first) + 1)
    if options.part == "rules":
        rules(seeds, options.wear)
    elif options.part == "serp":
        for seed in seeds:
            train(seed, options.decisions)
    else:
        speed()


if __name__ == "__main__":
    main()
