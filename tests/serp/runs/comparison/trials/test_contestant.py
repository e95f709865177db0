"""What a trial asks of an algorithm: greedy actions, alone and within the vetoes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from serp.errors import RunError
from serp.runs.comparison.algorithms import find_algorithm
from serp.runs.comparison.trial import Contestant, ExternalEnv, make_contestant
from tests.serp.runs.comparison.contest import OWN, Drawing, walk

PLACES = [np.array([x, 0.2]) for x in range(-2, 4)]


def trained(folder: Path, name: str, env_steps: int = 60) -> tuple[Contestant, Any]:
    task = walk(folder)
    algorithm = find_algorithm(name)
    bound = task.bind()
    contestant = make_contestant(algorithm, bound, algorithm.settings(task, {}), 0)
    contestant.train(env_steps, lambda step: None)
    return contestant, bound


@pytest.mark.parametrize("name", OWN)
def test_alone_it_does_what_the_agent_does_alone_and_vetoed_nothing_unsafe(
    tmp_path: Path, name: str
) -> None:
    contestant, _ = trained(tmp_path, name)
    agent = contestant.agent
    for state, x in map(agent.perceive, PLACES):
        assert agent.decide_as_baseline(state, x).action == contestant.greedy(state, x)
        decision = contestant.vetoed(state, x)
        assert not decision.unsafe
        assert decision.admissible[decision.action]


def test_an_external_one_is_held_by_the_same_vetoes(tmp_path: Path, external: None) -> None:
    contestant, _ = trained(tmp_path, "drawing")
    assert contestant.characteristics["who acts"] == "chance"
    states = [contestant.agent.perceive(place)[0] for place in PLACES]
    for place, state in zip(PLACES, states, strict=True):
        x = contestant.agent.perceive(place)[1]
        assert contestant.greedy(state, x) == 1
        decision = contestant.vetoed(state, x)
        assert decision.proposed == 1
        assert not decision.unsafe


def test_what_an_external_one_chooses_is_one_of_the_actions(
    tmp_path: Path, external: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A negative number is no last action, and 1.5 no 1."""
    contestant, bound = trained(tmp_path, "drawing")
    state, x = contestant.agent.perceive(PLACES[0])
    for wrong in ([-1], [4], [1.5], [[1]], [True], [], None):
        monkeypatch.setattr(Drawing, "act", lambda self, inputs, given=wrong: given)
        with pytest.raises(RunError, match="`drawing` failed: .*one whole number 0 ... 3 is want"):
            contestant.vetoed(state, x)
    env = ExternalEnv(bound, contestant.agent, 0)
    env.reset()
    for action in (-1, 4, 1.5):
        with pytest.raises(gym.error.InvalidAction, match="is no action of Discrete"):
            env.step(action)  # type: ignore[arg-type]
    env.step(np.int64(3))


@pytest.mark.parametrize("name", OWN)
def test_what_it_is_like_is_said_for_the_table_of_what_differs(tmp_path: Path, name: str) -> None:
    contestant, _ = trained(tmp_path, name, env_steps=1)
    characteristics = contestant.characteristics
    assert set(characteristics) == {"learner", "learned from", "planner", "who acts", "vetoes"}
    alone = name in ("dqn", "dqn-paper")
    assert (characteristics["planner"] == "none") == (characteristics["vetoes"] == "none") == alone
    assert (
        (characteristics["learner"] == "none")
        == (characteristics["learned from"] == "none")
        == (name == "mrp")
    )
