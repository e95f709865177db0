"""The guarantee holds whoever proposes: nothing unsafe while there is something else."""

from __future__ import annotations

from collections import Counter
from random import Random
from typing import Any

import numpy as np
import pytest

from serp.adaptation.adapted_model import AdaptedModel
from serp.control.decision import Actor, Decision, Reason
from serp.control.registry import strategy_names
from serp.model.flags import APPLICABLE, UNDEFINED, UNSAFE, risk_of
from serp.model.transition_model import TransitionModel
from serp.settings import Settings, resolve
from serp.training.agent import Agent
from serp.training.trainer import Trainer
from tests.serp.adaptation import worlds
from tests.serp.control.strategies.imagined import imagined
from tests.serp.planning.worlds import WORLDS

STEPS = 60
"""Env steps of training in each world."""


def settings_of(strategy: str, random: Random, seed: int) -> Settings:
    """Settings of all kinds; the planner has handed over long before the training is over."""
    return resolve(
        random.choice(("default", "paper")),
        imagined(seed).settings,
        {
            "arbiter": {
                "rho": 0.5,
                "rho_increment": 0.1,
                "rho_unit": "episode",
                "veto_horizon": random.choice(("step", "lookahead")),
                "after_veto": random.choice(("planner", "learner")),
                "exploration_slack": random.choice((None, 0.5, float("inf"))),
                "unmodelled": random.choice(("allow", "veto")),
                "r_min": random.choice((None, -0.5)),
            },
            "guide": {
                "strategy": strategy,
                "jump_stages": 2,
                "jump_tolerance": 5.0,
                "restrict_slack": random.choice((0.0, 0.2)),
                "imitation_steps": 40,
            },
            "planner": {"accepted_risk": random.choice((0.0, 0.02, 0.1))},
            "adaptation": {"mode": random.choice(("off", "full", "full", "residual"))},
            "training": {"random_steps": random.choice((0, 20))},
        },
    )


def kinds(model: TransitionModel, state: Any, size: int, accepted: float) -> list[str]:
    """What a model predicts of every environment action, read off the model itself.

    What is flagged, the file as written says, whatever the model has learned.
    """
    found = []
    written = getattr(model, "written", model)
    for action in range(size):
        if action >= len(model.actions):
            found.append("unknown")
            continue
        flags = model.transition(state.tolist(), action)[1]
        by_file = written.transition(state.tolist(), action)[1]
        found.append(
            "unsafe" if by_file & UNSAFE
            else "undefined" if flags & UNDEFINED
            else "not applicable" if not flags & APPLICABLE
            else "safe" if risk_of(flags) <= accepted
            else "risky" if risk_of(flags) < 1.0
            else "certain"
        )  # fmt: skip
    return found


def check(decision: Decision, expected: list[str], settings: Settings, met: Counter[str]) -> None:
    """Check one decision."""
    executed = expected[decision.action]
    unknown = "unknown" in expected and settings.arbiter.unmodelled == "allow"
    alternative = "safe" in expected or unknown
    if alternative:
        assert executed in ("safe", "unknown", "risky")
    if "safe" in expected:
        assert executed != "risky"
    if not {"safe", "risky", "undefined", "certain"}.isdisjoint(expected):
        assert executed != "unsafe"
    if executed == "unknown":
        assert settings.arbiter.unmodelled == "allow" or set(expected) == {"unknown"}
    assert decision.unsafe == (executed == "unsafe")
    if executed == "risky" and not decision.forecast.safe.any():
        assert decision.reason is Reason.LEAST_RISK or decision.executed_by is Actor.FALLBACK
    met[f"{executed}, {'with' if alternative else 'without'} alternative"] += 1
    met[decision.executed_by] += 1
    refused = decision.vetoed and decision.proposal_unsafe
    met["refused as unsafe"] += refused
    met["refused as too risky"] += refused and decision.reason is Reason.TOO_RISKY


def watch(agent: Agent, size: int, settings: Settings, met: Counter[str]) -> None:
    """Check every decision of training, and what the trained policy would do in its place.

    The model corrects itself while it is trained: what counts is that of the moment.
    """
    decide, decide_randomly = agent.decide, agent.decide_randomly
    model, accepted = agent.adaptation.model, settings.planner.accepted_risk

    def checked(decision: Decision, state: Any) -> Decision:
        check(decision, kinds(model, state, size, accepted), settings, met)
        return decision

    def deciding(state: Any, x: Any) -> Decision:
        checked(agent.decide_greedily(state, x), state)
        return checked(decide(state, x), state)

    agent.decide = deciding  # type: ignore[method-assign]
    agent.decide_randomly = lambda state: checked(decide_randomly(state), state)  # type: ignore[method-assign]


def learn_anything(agent: Agent, seed: int) -> None:
    """Let the model be corrected by anything that could ever be learned, and by nothing else."""
    model, rng = agent.adaptation.model, np.random.default_rng(seed)
    assert isinstance(model, AdaptedModel)
    if seed % 2:
        worlds.publish(model, rng, worlds.WILD)
    worlds.count(model, rng)
    agent.adaptation._learners = agent.adaptation._estimation = None


@pytest.mark.parametrize("strategy", strategy_names())
def test_nothing_unsafe_is_executed_while_there_is_an_alternative(strategy: str) -> None:
    """In training, exploration and D_0 included, and of the trained policy; real learners."""
    met: Counter[str] = Counter()
    for seed in range(WORLDS):
        task = imagined(seed).bind()
        settings = settings_of(strategy, Random(seed), seed)
        trainer = Trainer(task, settings, seed)
        size, agent = task.actions.size, trainer.agent
        if isinstance(agent.adaptation.model, AdaptedModel) and seed % 3:
            learn_anything(agent, seed)
        watch(agent, size, settings, met)
        while trainer.env_steps < STEPS:
            trainer.run_episode()
        assert agent.learner.updates > 0
    # It was not for want of danger, nor of anybody who would have gone there.
    assert met["unsafe, without alternative"] > 50
    assert met["safe, with alternative"] > 500
    assert met["refused as unsafe"] > 50
    # Nor of risks that nobody but the corrected model sees.
    assert met["risky, without alternative"] > 20
    assert met["refused as too risky"] > 0
    for actor in (Actor.PLANNER, Actor.LEARNER, Actor.EXPLORATION):
        assert met[actor] > 50, actor


@pytest.mark.parametrize("strategy", strategy_names())
def test_what_the_greedy_policy_does_follows_the_strategy(strategy: str) -> None:
    """In real worlds, before anything is learned and after."""
    compared = 0
    for seed in range(0, WORLDS, 3):
        task = imagined(seed).bind()
        changes = {"guide": {"strategy": strategy}, "arbiter": {"after_veto": "learner"}}
        trainer = Trainer(task, resolve("default", task.task.settings, changes), seed)
        agent = trainer.agent
        for trained in (False, True):
            while trained and trainer.env_steps < STEPS:
                trainer.run_episode()
            for k in range(30):
                state, x = agent.perceive(task.reset(seed=k)[0])
                decision = agent.decide_greedily(state, x)
                forecast, admissible = decision.forecast, decision.admissible
                if not admissible.any():
                    continue
                executed, planned = decision.action, forecast.choice
                compared += 1
                if strategy == "residual" and not trained:
                    assert (agent.learner.q_values(x) == 0).all()
                    known = admissible & task.actions.modelled
                    if known.any() and planned >= 0 and admissible[planned]:
                        # Single precision may tie what the planner tells apart.
                        assert (
                            forecast.value[executed]
                            == pytest.approx(forecast.value[planned], rel=1e-6)
                            or not task.actions.modelled[executed]
                        )
                elif strategy == "restrict":
                    best = forecast.value[admissible].max()
                    if np.isfinite(best):
                        assert forecast.value[executed] >= best - 0.2 * abs(best)
                elif strategy == "argmax-q":
                    q, target = agent.learner.q_values(x), agent.learner.target_q(x)
                    own = int(q.argmax())
                    if planned >= 0 and admissible[planned] and admissible[own]:
                        assert executed in (own, planned)
                        assert target[executed] == max(target[own], target[planned])
                else:
                    q = agent.learner.q_values(x, agent.arbiter.strategy.base(forecast))
                    assert executed == int(np.where(admissible, q, -np.inf).argmax())
    assert compared > 150
