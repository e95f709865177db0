"""The learner alone: whatever it wants is done, and counted all the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from serp.agent.agent import Agent
from serp.agent.decision import Actor, Reason
from serp.learning.dqn import Proposal
from serp.settings import resolve
from tests.serp.runs.comparison.contest import episodes_of, measured, walk

LEFT = 0


def baseline(folder: Path, **arbiter: Any) -> Agent:
    task = walk(folder).bind()
    settings = resolve(
        "default", task.task.settings, {"arbiter": arbiter, "learner": {"epsilon_start": 1.0}}
    )
    return Agent(task, settings, 0, baseline=True)


def test_nothing_is_refused_and_danger_is_counted(tmp_path: Path) -> None:
    agent = baseline(tmp_path, r_min=100.0, unmodelled="veto")
    state, _ = agent.perceive(np.array([-2.0, 0.0]))
    for exploratory in (False, True):
        proposal = Proposal(LEFT, exploratory, None)
        decision = agent.arbiter.judge_proposal(state, proposal)
        assert decision.action == decision.proposed == LEFT
        assert decision.reason is Reason.ACCEPTED
        assert not decision.vetoed
        assert decision.unsafe
        assert decision.executed_by is (Actor.EXPLORATION if exploratory else Actor.LEARNER)
        assert decision.admissible.all()
        assert agent.guarded.execute(state, proposal).action == LEFT
        assert agent.guarded.judge_proposal(state, proposal).action != LEFT


def test_it_explores_among_all_actions_and_asks_no_planner(tmp_path: Path) -> None:
    agent = baseline(tmp_path, rho=0.0, rho_increment=0.0)
    state, x = agent.perceive(np.array([0.0, 0.0]))
    decisions = [agent.decide(state, x) for _ in range(300)]
    explored = {d.action for d in decisions if d.executed_by is Actor.EXPLORATION}
    assert explored == {0, 1, 2, 3}
    assert {d.proposed_by for d in decisions} == {Actor.EXPLORATION}  # epsilon begins at 1


def test_settings_of_the_guide_do_not_reach_what_has_none(tmp_path: Path) -> None:
    plain = measured(tmp_path, "dqn")
    guided = measured(tmp_path, "dqn", changes={"guide": {"strategy": "evidence"}})
    assert episodes_of(guided) == episodes_of(plain)
    assert guided.evaluations == plain.evaluations
