"""What learners of stable-baselines3 are worth under the arbiter, and alone.

    python tests/benchmarks/study_guarded.py TASK [TASK ...] [--learners dqn maskable-ppo ...]
        [--strategies alone learner ...] [--seeds 0 1 2] [--env-steps N] [--episodes N]
        [--gae-lambda X]

Trained alone, a learner proposes and executes what it likes; otherwise it is trained in a
`serp.GuardedEnv` with this strategy. Each line has the mean return of the training's episodes, the
return of the learner's greedy choice without planner and veto (`alone`) and within the arbiter
(`arbiter`) after the training, and of the training's env steps how many executed an action that
the file as written flags unsafe (`unsafe`), and how many did although an action that it does not
flag was there (`avoidable`; wanted under the arbiter: 0).
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import sb3_contrib
import stable_baselines3

import serp
from serp.agent.agent import Agent
from serp.agent.step_record import StepRecord
from serp.runs.comparison.trial import ExternalEnv
from serp.runs.guarded_env import EvaluationEnv, TaskEnv
from serp.settings import resolve
from serp.tasks.registry import find_task
from serp_adapters.stable_baselines3 import ExecutedActionBuffer

# As rl-baselines3-zoo tunes them for small tasks, as far as a budget of some thousand steps allows.
_OFF_POLICY = {
    "learning_rate": 1e-3, "batch_size": 64, "buffer_size": 50_000, "learning_starts": 200,
    "train_freq": 1, "gradient_steps": 1, "target_update_interval": 200, "gamma": 0.99,
    "exploration_fraction": 0.3, "exploration_final_eps": 0.04,
}  # fmt: skip
_ON_POLICY: dict[str, Any] = {
    "n_steps": 256, "batch_size": 64, "gae_lambda": 0.9, "gamma": 0.99, "n_epochs": 10,
}  # fmt: skip
LEARNERS: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "dqn": (stable_baselines3.DQN, _OFF_POLICY),
    "qr-dqn": (sb3_contrib.QRDQN, _OFF_POLICY),
    "ppo": (stable_baselines3.PPO, _ON_POLICY),
    "maskable-ppo": (sb3_contrib.MaskablePPO, _ON_POLICY),
}


def watch(env: TaskEnv, counts: Counter[str], returns: list[float]) -> None:
    """Count the unsafe steps of an environment, and collect the returns of its episodes."""
    after_step = env.after_step

    def watching(step: StepRecord) -> dict[str, Any]:
        decision = step.decision
        flagged = decision.unsafe
        forecast = decision.forecast
        counts["steps"] += 1
        counts["learner"] += decision.executed_by == "learner"
        counts["unsafe"] += flagged
        counts["avoidable"] += flagged and bool(forecast.safe.any())
        if step.last:
            returns.append(step.episode.return_)
        return after_step(step)

    env.after_step = watching  # type: ignore[method-assign]


def play(act: Callable[[Any, Any], int], env: TaskEnv, episodes: int, *, masked: bool) -> float:
    """Return the mean return of a greedy policy."""
    returns: list[float] = []
    watch(env, Counter(), returns)
    x, _ = env.reset(seed=1000)
    while len(returns) < episodes:
        masks = env.action_masks() if masked and isinstance(env, EvaluationEnv) else None
        x, _, terminated, truncated, _ = env.step(act(x, masks))
        if terminated or truncated:
            x, _ = env.reset()
    return float(np.mean(returns))


def trial(
    name: str, learner: str, strategy: str, seed: int, env_steps: int, episodes: int
) -> dict[str, Any]:
    """Train once; return the numbers of a line."""
    task, (make, options) = find_task(name), LEARNERS[learner]
    changes = {"guide": {"strategy": strategy}} if strategy != "alone" else {}
    settings = resolve("default", task.settings, changes)
    env: Any
    if strategy == "alone":
        bound = task.bind()
        env = ExternalEnv(bound, Agent(bound, settings, seed), seed)
        if learner == "maskable-ppo":  # without masks it is PPO
            make = stable_baselines3.PPO
    else:
        env = serp.GuardedEnv(task, settings=changes, seed=seed)
        if "buffer_size" in options:
            options = {**options, "replay_buffer_class": ExecutedActionBuffer}
    counts: Counter[str] = Counter()
    returns: list[float] = []
    watch(env, counts, returns)
    begin = time.process_time()
    model = make("MlpPolicy", env, seed=seed, device="cpu", **options)
    model.learn(env_steps)
    seconds = time.process_time() - begin

    def act(x: Any, masks: Any) -> int:
        more = {} if masks is None else {"action_masks": masks}
        return int(model.predict(x, deterministic=True, **more)[0])

    bound = task.bind()
    result = {"training": float(np.mean(returns))}
    result["alone"] = play(act, ExternalEnv(bound, env._agent, 1000), episodes, masked=False)
    if strategy != "alone":
        masked = learner == "maskable-ppo"
        result["arbiter"] = play(act, env.evaluation(), episodes, masked=masked)
    result |= {"unsafe": counts["unsafe"], "avoidable": counts["avoidable"]}
    return result | {"learner": counts["learner"] / counts["steps"], "seconds": seconds}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("tasks", nargs="+")
    usual = ["dqn", "maskable-ppo"]
    parser.add_argument("--learners", nargs="+", default=usual, choices=LEARNERS)
    parser.add_argument("--strategies", nargs="+", default=["alone", "learner", "evidence"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--env-steps", type=int, default=10_000)
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--gae-lambda", type=float, default=0.9, help="of the on-policy learners")
    given = parser.parse_args()
    _ON_POLICY["gae_lambda"] = given.gae_lambda
    for task in given.tasks:
        for learner in given.learners:
            for strategy in given.strategies:
                for seed in given.seeds:
                    numbers = trial(task, learner, strategy, seed, given.env_steps, given.episodes)
                    shown = "  ".join(f"{key} {value:.4g}" for key, value in numbers.items())
                    print(f"{task} {learner} {strategy} seed {seed}: {shown}", flush=True)


if __name__ == "__main__":
    main()
