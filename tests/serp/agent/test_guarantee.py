"""The guarantee: nothing unsafe is executed while there is something else, whoever proposes."""

from collections import Counter
from random import Random
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.agent.agent import Agent
from serp.agent.arbiter import Arbiter
from serp.agent.decision import Decision, Reason
from serp.agent.step_record import StepRecord
from serp.learning.dqn import Proposal
from serp.model.flags import APPLICABLE, UNSAFE
from serp.model.transition_model import Vector
from serp.runs.trainer import Trainer
from serp.settings import resolve
from serp.tasks.registry import find_task
from serp.tasks.task import BoundTask
from tests.generated.profile import examples
from tests.serp import lava
from tests.serp.agent.decisions import (
    MODELS,
    RISKY,
    View,
    Wild,
    action_maps,
    arbiter_of,
    proposer_of,
)
from tests.serp.planning.worlds import states_of


def every_decision(arbiter: Arbiter, state: Vector, seed: int) -> list[Decision]:
    """Decide in all the ways in which a decision is executed under vetoes."""
    proposer, size = proposer_of(Wild(seed, arbiter.actions.size)), arbiter.actions.size
    with np.errstate(over="ignore", invalid="ignore"):
        return [
            arbiter.decide(state, proposer),
            arbiter.decide_greedily(state, proposer),
            arbiter.plan(state),
            *(arbiter.judge_proposal(state, Proposal(k, True, None)) for k in range(size)),
        ]


def test_nothing_unsafe_is_executed_while_there_is_an_alternative() -> None:
    """Under every strategy, whatever was learned of the world and of values."""
    met: Counter[str] = Counter()

    @examples(2_200)
    @given(
        strategy=st.sampled_from(("evidence", "mixture")),
        model=st.sampled_from((*MODELS, *RISKY)),
        actions=st.integers(0, 4),
        seed=st.integers(0, 2**32),
    )
    def holds(strategy: str, model: Any, actions: int, seed: int) -> None:
        random = Random(seed)
        arbiter = arbiter_of(list(action_maps(model, random))[actions], random, strategy)
        arbiter._exploration_bonus = lambda forecast: (
            forecast._replace(choice=random.randrange(arbiter.actions.size))
            if random.random() < 0.3
            else forecast
        )
        for state in states_of(model, random, 3):
            view = View.of(arbiter, state)
            for decision in every_decision(arbiter, state, seed):
                check(decision, view, arbiter.settings.unmodelled == "allow")

    def check(decision: Decision, view: View, unknown_allowed: bool) -> None:
        kinds, executed = view.kind, view.kind[decision.action]
        unknown = "unknown" in kinds and unknown_allowed
        if "safe" in kinds:
            assert executed == "safe" or (executed == "unknown" and unknown)
        elif unknown:
            assert executed in ("unknown", "risky")
        elif not {"risky", "undefined", "certain"}.isdisjoint(kinds):
            assert executed in ("risky", "undefined", "certain")
            if "risky" not in kinds and "undefined" in kinds:
                assert executed == "undefined"  # may be damage, which the others are for certain
        elif any(view.applicable):
            # Nothing is left but damage: it is done knowingly, by an action that has effects.
            assert executed == "unsafe"
        elif "not applicable" in kinds:
            assert executed == "not applicable"
        assert decision.unsafe == (executed == "unsafe")
        met[f"{executed}, {'with' if 'safe' in kinds or unknown else 'without'} alternative"] += 1
        met["refused as unsafe"] += decision.vetoed and decision.proposal_unsafe
        met["refused as too risky"] += decision.reason is Reason.TOO_RISKY

    holds()
    # The danger was there.
    assert met["unsafe, without alternative"] > 500
    assert met["not applicable, without alternative"] > 50
    assert met["safe, with alternative"] > 5_000
    assert met["unknown, with alternative"] > 500
    assert met["undefined, without alternative"] > 50
    assert met["risky, without alternative"] > 500
    assert met["refused as unsafe"] > 500
    assert met["refused as too risky"] > 100


@pytest.mark.parametrize(
    ("name", "steps", "strategy"),
    [("lava", 500, "mixture"), ("lava", 300, "evidence"), ("cliff", 500, "mixture")],
)
def test_every_decision_of_a_training_is_judged_again_by_the_file_as_written(
    name: str, steps: int, strategy: str
) -> None:
    """The model adapts itself meanwhile."""
    task = lava.task() if name == "lava" else find_task(name)
    small = {"hidden": [16], "batch_size": 16, "members": 1}
    settings: dict[str, Any] = {"learner": small, "guide": {"strategy": strategy}}
    counts = train(task.bind(), steps, 1, settings)
    assert counts["decisions"] >= steps
    assert counts["avoidable"] == counts["avoidable risk"] == 0


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
