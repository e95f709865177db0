"""Re-judge every decision of trainings by the domain file as written.

    python tests/benchmarks/study_safety.py [--steps N] [--tasks lava cliff soccer] [--seeds S ...]

Of each training it prints how often what was executed is flagged by the file although an action
that it does not flag was there (wanted: 0), how often a risk was taken that is not accepted while
an accepted one was there (wanted: 0), and how often something unsafe happened.
"""

from __future__ import annotations

import argparse
from collections import Counter
from typing import Any

from serp.agent.agent import Agent
from serp.agent.decision import Decision
from serp.agent.step_record import StepRecord
from serp.model.flags import APPLICABLE, UNSAFE
from serp.model.transition_model import Vector
from serp.runs.trainer import Trainer
from serp.settings import resolve
from serp.tasks.registry import find_task
from serp.tasks.task import BoundTask
from tests.serp import lava


def judge(agent: Agent, decision: Decision, state: Vector, counts: Counter[str]) -> None:
    """Count one decision, judged by the file as written."""
    task = agent.task
    flags = [task.model.transition(state.tolist(), k)[1] for k in range(len(task.model.actions))]
    executed = int(decision.forecast.ground[decision.action])
    counts["decisions"] += 1
    if executed >= 0 and flags[executed] & UNSAFE:
        counts["flagged"] += 1
        counts["avoidable"] += any(f & (APPLICABLE | UNSAFE) == APPLICABLE for f in flags)
    counts["avoidable risk"] += bool(
        not decision.forecast.safe[decision.action]
        and executed >= 0
        and decision.forecast.safe.any()
    )


def watched(trainer: Trainer) -> Counter[str]:
    """Count every decision of a training from now on."""
    counts: Counter[str] = Counter()
    agent = trainer.agent
    decide, decide_randomly = agent.decide, agent.decide_randomly

    def deciding(state: Vector, x: Vector) -> Decision:
        decision = decide(state, x)
        judge(agent, decision, state, counts)
        return decision

    def deciding_randomly(state: Vector) -> Decision:
        decision = decide_randomly(state)
        judge(agent, decision, state, counts)
        return decision

    def on_step(step: StepRecord) -> None:
        counts["damage"] += step.unsafe

    agent.decide = deciding  # type: ignore[method-assign]
    agent.decide_randomly = deciding_randomly  # type: ignore[method-assign]
    trainer.on_step = on_step
    return counts


def train(task: BoundTask, steps: int, seed: int, changes: dict[str, Any]) -> Counter[str]:
    """Train for so many env steps; return the counts."""
    trainer = Trainer(task, resolve("default", task.task.settings, changes), seed)
    counts = watched(trainer)
    while trainer.env_steps < steps:
        trainer.run_episode()
    return counts


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=10_000)
    parser.add_argument("--tasks", nargs="+", default=["lava", "cliff", "soccer"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    chosen = parser.parse_args()
    for name in chosen.tasks:
        for seed in chosen.seeds:
            task = lava.task() if name == "lava" else find_task(name)
            counts = train(task.bind(), chosen.steps, seed, {})
            print(
                f"{name}, seed {seed}: {counts['decisions']:,} decisions, "
                f"{counts['flagged']} flagged, {counts['avoidable']} of them avoidable; "
                f"{counts['avoidable risk']} avoidable risks; {counts['damage']} times damage",
                flush=True,
            )


if __name__ == "__main__":
    main()
