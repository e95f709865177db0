"""Every decision of a training, judged again by the domain file as written."""

from __future__ import annotations

from collections import Counter
from typing import Any

from serp.agent.agent import Agent
from serp.agent.decision import Decision
from serp.agent.step_record import StepRecord
from serp.model.flags import APPLICABLE, UNSAFE
from serp.model.transition_model import Vector
from serp.runs.trainer import Trainer
from serp.settings import resolve
from serp.tasks.task import BoundTask


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
