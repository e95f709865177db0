"""A film shows every step, every veto with its reason, and takes the time that the steps take."""

import itertools

import pytest
from PIL import ImageColor

from serp._util import figures
from serp.agent.agent import Agent
from serp.runs.evaluation import evaluate, play
from serp.settings import resolve
from serp.ui.pictures.film import HOLD, Mark, film
from tests.serp.sample_tasks import reckless
from tests.serp.ui.pictures.scene import bound, drawn

RED = ImageColor.getrgb(figures.REFUSED)


@pytest.fixture
def agent(tmp_path):
    task = drawn(tmp_path)
    changes = {"guide": {"strategy": "mixture"}, "arbiter": {"rho": 1.0}}
    return reckless(Agent(task.bind(), resolve("default", task.settings, changes), 0))


def steps(agent, folder, policy="serp"):
    played = play(agent, bound(folder), policy, episodes=3)
    return [step for episode in played for step in episode]


def test_every_veto_is_shown_until_it_can_be_read(agent, tmp_path):
    frames = list(film(agent, bound(tmp_path)))
    shown = {mark for frame in frames for mark in frame.caption.marks}
    vetoed = [step for step in steps(agent, tmp_path) if step.decision.vetoed]
    assert len(vetoed) > 3
    for step in vetoed:
        why = agent.arbiter.explain(step.decision, step.state).removeprefix("left: ")
        assert Mark(f"Refused in step {step.number}: left, proposed by learner", why) in shown
    for frame in frames:
        corner = frame.image.getpixel((0, frame.image.height - 1))
        assert (corner == RED) == bool(frame.caption.marks)
    for _, episode in itertools.groupby(frames, lambda frame: frame.caption.facts[0]):
        runs = [(marks, list(group)) for marks, group in
                itertools.groupby(episode, lambda frame: frame.caption.marks)]  # fmt: skip
        for (marks, group), (after, _) in itertools.pairwise([*runs, ((), [])]):
            if marks and not after:
                assert sum(frame.seconds for frame in group) >= HOLD - 1e-9


@pytest.mark.parametrize("policy", ["serp", "learner"])
def test_every_step_that_an_evaluation_measures_has_a_frame_that_says_who_acts(
    agent, tmp_path, policy
):
    frames = [*film(agent, bound(tmp_path), policy, 4, 3)]
    shown = [frame.caption for frame in frames if frame.caption.actor is not None]
    assert len(frames) == len(shown) + 4  # each episode's beginning
    played = [step for episode in play(agent, bound(tmp_path), policy, episodes=4, seed=3)
              for step in episode]  # fmt: skip
    assert [(caption.actor, caption.action) for caption in shown] == [
        (step.decision.executed_by, agent.task.actions.name(step.decision.action))
        for step in played
    ]
    measured = evaluate(agent, bound(tmp_path), policy, episodes=4, seed=3)
    assert len(shown) == sum(measured.lengths)
