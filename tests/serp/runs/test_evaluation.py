"""Evaluating is only looking: nothing of the agent changes."""

import json
from typing import get_args

import pytest

from serp.errors import SettingsError
from serp.runs.evaluation import Policy, evaluate
from serp.runs.trainer import Trainer
from serp.settings import resolve
from tests.serp.sample_tasks import Corridor, corridor, reckless

POLICIES = get_args(Policy)


def trained(folder, episodes=6, **changes):
    task = corridor(folder)
    trainer = Trainer(task.bind(), resolve("default", task.settings, changes), 4)
    for _ in range(episodes):
        next(trainer.run())
    return trainer


def state(trainer):
    arrays, meta = trainer.agent.state_dict()
    return {k: a.tobytes() for k, a in arrays.items()}, json.dumps(meta, sort_keys=True)


@pytest.mark.parametrize("policy", POLICIES)
def test_evaluating_depends_on_its_seed_and_leaves_the_agent_as_it_was(tmp_path, policy):
    trainer = trained(tmp_path)
    before = state(trainer)
    one, same, other = (
        evaluate(trainer.agent, corridor(tmp_path).bind(), policy, episodes=6, seed=seed)
        for seed in (1, 1, 2)
    )
    assert one == same
    assert one.returns != other.returns
    assert state(trainer) == before


def test_every_episode_has_a_seed_of_its_own_that_training_does_not_use(tmp_path):
    seeds = []

    class Noting(Corridor):
        def reset(self, *, seed=None, options=None):
            seeds.append(seed)
            return super().reset(seed=seed, options=options)

    task = corridor(tmp_path, Noting)
    trainer = Trainer(task.bind(), resolve("default", task.settings), 0)
    for _ in range(5):
        next(trainer.run())
    evaluate(trainer.agent, task.bind(), episodes=5, seed=0)  # the seed of the training
    assert len(set(seeds)) == 10
    assert None not in seeds


def test_the_mixture_refuses_what_the_learner_alone_does(tmp_path):
    always = {"rho": 1.0, "rho_increment": 0.0}
    agent = reckless(trained(tmp_path, 0, arbiter=always, guide={"strategy": "mixture"}).agent)
    alone = evaluate(agent, corridor(tmp_path).bind(), "learner", episodes=5)
    mixed = evaluate(agent, corridor(tmp_path).bind(), "serp", episodes=5)
    assert alone.unsafe_executed == alone.avoidable_unsafe >= 5
    assert alone.unsafe_observed == 5  # one an episode: the last step into the pit may slip
    assert alone.vetoes == 0
    assert all(value < -4 for value in alone.returns)
    assert mixed.unsafe_executed == mixed.avoidable_unsafe == mixed.unsafe_observed == 0
    assert mixed.vetoes > 0


def test_what_cannot_be_evaluated_is_refused(tmp_path):
    agent, task = trained(tmp_path, 1).agent, corridor(tmp_path).bind()
    with pytest.raises(SettingsError, match="no policy `plan`; did you mean `planner`"):
        evaluate(agent, task, "plan")
    with pytest.raises(SettingsError, match="at least one for an evaluation, not 0"):
        evaluate(agent, task, episodes=0)
