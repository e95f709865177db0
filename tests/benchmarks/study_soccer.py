"""How a defender learns in the paper's protocol: 28 games a cycle, repeated with five seeds.

    python tests/benchmarks/study_soccer.py --algorithm serp --seeds 0-4
    python tests/benchmarks/study_soccer.py --algorithm dqn --seeds 0-4 --decisions 90000
    python tests/benchmarks/study_soccer.py --algorithm planner --seeds 0-4 --contests 2000

`serp` trains as `serp plan-and-learn --domain soccer` does, `dqn` is the same learner with the same
settings on its own: no planner, no veto, exploration among all actions. Both print the return in
training a game and around some numbers of decisions, how often the unsafe action was executed, how
often it hit, and the learner alone at the end. `planner` is monitor-replanning alone.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

GAMES = 28
EVALUATION_CONTESTS = 600
EVALUATION_SEED = 99
MARKS = (1_000, 2_000, 3_000, 5_000, 10_000, 20_000, 30_000, 60_000, 90_000)
WINDOW = 1_000
"""Decisions around a mark whose contests count for it, before and after."""


def study(options: argparse.Namespace, seed: int) -> dict[str, Any]:
    import threadpoolctl
    import torch

    torch.set_num_threads(1)
    with threadpoolctl.threadpool_limits(1):
        return {"serp": train, "dqn": train_alone, "planner": planner_alone}[options.algorithm](
            options, seed
        )


def train(options: argparse.Namespace, seed: int) -> dict[str, Any]:
    from serp.evaluation import evaluate
    from serp.registry import load_task
    from serp.settings import resolve
    from serp.training import Trainer

    task = load_task("soccer")
    settings = resolve(options.preset, task.settings, options.set)
    log = Log()
    with dataclasses.replace(task, make_env=log.make_env).bind() as bound, task.bind() as other:
        trainer = Trainer(bound, settings, seed)
        start = time.perf_counter()
        while not log.over(options):
            trainer.run_episode()
        seconds = time.perf_counter() - start
        learner = evaluate(
            trainer.agent, other, "learner", episodes=EVALUATION_CONTESTS, seed=EVALUATION_SEED
        )
        serp = evaluate(
            trainer.agent, other, "serp", episodes=EVALUATION_CONTESTS, seed=EVALUATION_SEED
        )
    return {
        "seed": seed,
        **log.summary(),
        "predicted_unsafe_executed": trainer.unsafe_executed,
        "vetoes": trainer.vetoes,
        "learner_alone": learner.mean,
        "learner_in_vetoes": serp.mean,
        "seconds": seconds,
    }


def train_alone(options: argparse.Namespace, seed: int) -> dict[str, Any]:
    """Train the same learner without planner and veto."""
    from serp.agent import Agent
    from serp.registry import load_task
    from serp.settings import resolve

    task = load_task("soccer")
    settings = resolve(options.preset, task.settings, options.set)
    log = Log()
    with dataclasses.replace(task, make_env=log.make_env).bind() as bound, task.bind() as other:
        agent = Agent(bound, settings, seed)
        learner = agent.learner
        start = time.perf_counter()
        episode = 0
        while not log.over(options):
            raw, _ = bound.reset(seed=_seed(seed, episode))
            episode += 1
            _, x = agent.perceive(raw)
            ended = False
            while not ended:
                action = learner.propose(x, None).action
                raw, reward, terminated, truncated, _ = bound.step(action)
                _, following = agent.perceive(raw)
                learner.remember(x, action, reward, following, terminated, truncated, None, False)
                learner.learn()
                x, ended = following, terminated or truncated
        seconds = time.perf_counter() - start
        returns = []
        for episode in range(EVALUATION_CONTESTS):
            raw, _ = other.reset(seed=_seed(EVALUATION_SEED, episode))
            total, ended = 0.0, False
            while not ended:
                _, x = agent.perceive(raw)
                raw, reward, terminated, truncated, _ = other.step(int(learner.greedy(x)))
                total, ended = total + reward, terminated or truncated
            returns.append(total)
    return {
        "seed": seed,
        **log.summary(),
        "learner_alone": float(np.mean(returns)),
        "seconds": seconds,
    }


def planner_alone(options: argparse.Namespace, seed: int) -> dict[str, Any]:
    from serp.agent import Agent
    from serp.evaluation import evaluate
    from serp.registry import load_task
    from serp.settings import resolve

    task = load_task("soccer")
    settings = resolve(options.preset, task.settings, options.set)
    with task.bind() as bound:
        result = evaluate(
            Agent(bound, settings, seed), bound, "planner", episodes=options.contests, seed=seed
        )
    return {
        "seed": seed,
        "planner": result.mean,
        "standard_error": float(np.std(result.returns) / len(result.returns) ** 0.5),
        "decisions_a_contest": float(np.mean(result.lengths)),
        "unsafe_executed": result.unsafe_executed,
    }


class Log:
    """What happened in the environment, read off it and not off what the program says."""

    def __init__(self) -> None:
        self.decisions = 0
        self.game: list[int] = []
        self.contest_return: list[float] = []
        self.ended_at: list[int] = []
        self.unsafe: list[int] = []
        self.hits = 0

    def make_env(self, **kwargs: Any) -> Any:
        import gymnasium

        from serp_adapters.soccer import make_env

        log = self

        class Logged(gymnasium.Wrapper[Any, Any, Any, Any]):
            total = 0.0

            def reset(self, **options: Any) -> Any:
                self.total = 0.0
                return self.env.reset(**options)

            def step(self, action: Any) -> Any:
                result = self.env.step(action)
                _, reward, terminated, truncated, info = result
                log.decisions += 1
                self.total += float(reward)
                if terminated or truncated:
                    log.game.append(info["game"])
                    log.contest_return.append(self.total)
                    log.ended_at.append(log.decisions)
                    log.unsafe.append(info["unsafe_choices"])
                    log.hits += info["damaging_hits"]
                return result

        return Logged(make_env(**kwargs))

    def over(self, options: argparse.Namespace) -> bool:
        if options.decisions:
            return self.decisions >= options.decisions
        return bool(self.game) and self.game[-1] >= GAMES

    def summary(self) -> dict[str, Any]:
        returns, ended = np.array(self.contest_return), np.array(self.ended_at)
        games = np.array(self.game)
        first = ended <= 30_000
        return {
            "decisions": self.decisions,
            "contests": len(returns),
            "games": [float(returns[games == k].mean()) for k in range(min(GAMES, games.max() + 1))
                      if (games == k).any()],
            "marks": {
                mark: float(returns[np.abs(ended - mark) <= WINDOW].mean())
                for mark in MARKS
                if mark + WINDOW <= self.decisions
            },
            "unsafe_executed": int(sum(self.unsafe)),
            "unsafe_share_of_first_30000": float(
                np.array(self.unsafe)[first].sum() / max(1, min(self.decisions, 30_000))
            ),
            "damaging_hits": self.hits,
        }  # fmt: skip


def _seed(seed: int, episode: int) -> int:
    sequence = np.random.SeedSequence(entropy=seed, spawn_key=(1, episode))
    return int(sequence.generate_state(1)[0])


def _seeds(text: str) -> list[int]:
    first, _, last = text.partition("-")
    return list(range(int(first), int(last or first) + 1))


def _change(text: str) -> tuple[str, str, Any]:
    name, _, value = text.partition("=")
    section, _, setting = name.partition(".")
    return section, setting, json.loads(value)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--algorithm", choices=("serp", "dqn", "planner"), default="serp")
    parser.add_argument("--preset", default="default")
    parser.add_argument("--seeds", default=list(range(5)), type=_seeds)
    parser.add_argument("--decisions", type=int, help=f"instead of {GAMES} games")
    parser.add_argument("--contests", type=int, default=2_000, help="of the planner alone")
    parser.add_argument(
        "--set", action="append", default=[], type=_change, metavar="SECTION.NAME=JSON"
    )
    parser.add_argument("--jobs", default=os.cpu_count(), type=int)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    changes: dict[str, dict[str, Any]] = {}
    for section, setting, value in options.set:
        changes.setdefault(section, {})[setting] = value
    options.set = changes
    results = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for result in pool.map(study, [options] * len(options.seeds), options.seeds):
            results.append(result)
            numbers = {k: v for k, v in result.items() if not isinstance(v, dict | list)}
            print("  ".join(f"{k} {_shown(v)}" for k, v in numbers.items()), flush=True)
    for name in results[0]:
        _print_over_seeds(name, [result[name] for result in results])
    if options.json:
        options.json.write_text(json.dumps(results, indent=1) + "\n")


def _print_over_seeds(name: str, values: list[Any]) -> None:
    if isinstance(values[0], dict):
        for key in values[0]:
            _print_over_seeds(f"{name}, {key}", [v[key] for v in values if key in v])
    elif isinstance(values[0], list):
        for k in range(min(map(len, values))):
            _print_over_seeds(f"{name}, {k + 1}", [v[k] for v in values])
    elif name != "seed":
        spread = np.std(values, ddof=1) if len(values) > 1 else 0.0
        print(f"{name:>32}: {_shown(float(np.mean(values)))} ± {_shown(float(spread))}")


def _shown(value: float) -> str:
    return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"


if __name__ == "__main__":
    main()
