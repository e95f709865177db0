"""The environment in which other libraries train: what is proposed, and what is executed."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import serp
from serp.errors import Notice
from serp.model.flags import APPLICABLE, UNSAFE
from serp.runs.evaluation import evaluate
from serp.runs.recording import COLUMNS, open_recording
from serp.runs.run import Run
from serp.runs.step_account import account_of_step
from tests.serp.runs.runs import rows
from tests.serp.sample_tasks import corridor

SMALL = {
    "hidden": [8], "members": 1, "batch_size": 4,
    "learning_starts": 10, "epsilon_end": 0.3,
}  # fmt: skip
ALWAYS = {"guide": {"strategy": "mixture"}, "arbiter": {"rho": 1.0}, "learner": SMALL}


def same(one, other):
    """Whether two states are equal: arrays and JSON values."""
    assert one[0].keys() == other[0].keys()
    equal = all(np.array_equal(one[0][name], other[0][name]) for name in one[0])
    return equal and bool(one[1] == other[1])


def test_a_loop_outside_makes_the_steps_of_a_training(tmp_path):
    """With the same learner: the same decisions, episodes and model, in the same run folder."""
    task, changes = corridor(tmp_path), {**ALWAYS, "planner": {"name": "lookahead"}}
    run = serp.plan_and_learn(
        task, settings=changes, seed=3, env_steps=200, out=tmp_path / "inside", quiet=True
    )
    env = serp.GuardedEnv(task, settings=changes, seed=3, out=tmp_path / "outside")
    learner = env._agent.learner
    for _ in range(len(run.metrics["episode"])):
        x, _ = env.reset()
        action, over = learner.propose(x, None).action, False
        while not over:
            following, reward, terminated, truncated, info = env.step(action)
            over = terminated or truncated
            if not over:
                action = learner.propose(following, None).action
            executed = info["executed_action"]
            allowed = None if over else env.action_masks()
            learner.remember(x, executed, reward, following, terminated, truncated, -1, allowed)
            learner.learn()
            x = following
    env.close()
    # Which proposals were exploration, only the learner knows; the environment plans more often.
    plan = {"depth", "bound", "indifferent"}
    sight = {"safety_alone", "saw_all", "by_cells", "cut_short", "layers_seen", "indifferent"}
    learner_alone = {"epsilon", "loss", "wall_time", "learner_steps", "exploration_steps"}
    for name, unknown in (
        ("decisions", {"proposed_by", "executed_by"} | plan),
        ("metrics", learner_alone | sight),
    ):
        ours, theirs = (rows(tmp_path / where, name) for where in ("inside", "outside"))
        for one, other in zip(ours, theirs, strict=True):
            assert all(one[column] == other[column] for column in one.keys() - unknown)
    plan |= {"choice", "value", "path_risk", "safe_steps"}
    names = set(COLUMNS) - {"proposed_by", "executed_by", "reason"} - plan
    ours, theirs = (
        open_recording(tmp_path / where).columns(*names) for where in ("inside", "outside")
    )
    assert all(ours[name].tobytes() == theirs[name].tobytes() for name in names)
    read = Run(tmp_path / "outside")  # it has no checkpoint
    assert account_of_step(read, read.recording(), 3).predictions
    assert (tmp_path / "outside" / "summary.json").exists()
    assert same(env._agent.adaptation.state_dict(), run.agent.adaptation.state_dict())


@pytest.mark.filterwarnings("ignore::serp.errors.Notice")
@pytest.mark.parametrize("strategy", ["mixture", "evidence"])
def test_what_the_masks_allow_is_executed_and_nothing_else_and_nothing_unsafe(strategy):
    random = np.random.default_rng(1)
    settings = {"guide": {"strategy": strategy}, "arbiter": {"rho": 0.6}, "learner": SMALL}
    env = serp.GuardedEnv("cliff", settings=settings, seed=1)
    model, refused, free = env._task.model, 0, 0
    env.reset()
    for _ in range(400):
        state, masks = env.running.state, env.action_masks()
        flags = [model.transition(state.tolist(), k)[1] for k in range(len(model.actions))]
        action = int(random.integers(len(masks)))
        _, _, terminated, truncated, info = env.step(action)
        executed, decision = info["executed_action"], env.last_decision
        assert masks[executed]
        assert (executed == action) == masks[action]
        free += masks.sum() > 1
        refused += bool(env.explain())
        assert decision is not None and executed == decision.action
        assert (info["executed_by"], info["reason"]) == (decision.executed_by, decision.reason)
        if flags[executed] & UNSAFE:
            assert not any(f & (APPLICABLE | UNSAFE) == APPLICABLE for f in flags)
        if terminated or truncated:
            env.reset()
    assert refused > 10 and free > 10
    env.close()


def test_it_is_an_environment_as_gymnasium_has_it(tmp_path):
    env = serp.GuardedEnv("cartpole", settings=ALWAYS)
    with pytest.raises(gym.error.ResetNeeded):
        env.action_masks()
    with pytest.warns(UserWarning, match="Box observation space"):
        check_env(env, skip_render_check=True)
    env.reset()
    with pytest.raises(gym.error.InvalidAction):
        env.step(99)
    began = [[env.reset(seed=seed)[0].tolist(), env.reset()[0].tolist()] for seed in (7, 8, 7)]
    assert began[0] == began[2] != began[1]


def test_a_reset_in_mid_episode_is_a_truncation(tmp_path):
    limit, agents, random = 7, [], np.random.default_rng(2)
    proposed = random.integers(4, size=60 * limit)
    for limited in (True, False):
        settings = {
            "learner": SMALL,
            "planner": {"depth": 2},
            "training": {"episode_steps": limit if limited else 10_000},
        }
        folder = tmp_path / f"{limited}"
        env = serp.GuardedEnv("cliff", settings=settings, seed=4, out=folder)
        env.reset()
        env.reset()  # an episode without a step is none
        made = 0
        with pytest.warns(Notice, match=r"^4 times in \d+ env steps, a step was unsafe"):
            for action in proposed:
                _, _, terminated, truncated, _ = env.step(action)
                made += 1
                if terminated or made == limit:
                    assert limited or not truncated
                    env.reset()
                    made = 0
        agents.append(env._agent)
        env.close()
    assert same(*(agent.state_dict() for agent in agents))
    assert agents[0].strategy.evidence.learner.episodes > 5
    for name in ("decisions", "metrics"):
        one, other = (rows(tmp_path / f"{limited}", name) for limited in (True, False))
        assert one == other


def test_its_evaluation_plays_the_episodes_of_the_trained_policy(tmp_path):
    """The training goes on as if there had not been any."""
    task = corridor(tmp_path)
    env, undisturbed = (serp.GuardedEnv(task, settings=ALWAYS, seed=2) for _ in range(2))
    agent = env._agent
    for one in (env, undisturbed):
        one.reset()
        one.step(1)
    apart, lengths = env.evaluation(seed=5), []
    for _ in range(3):
        x, over = apart.reset()[0], False
        while not over:
            x, _, terminated, truncated, _ = apart.step(agent.learner.propose_greedily(x).action)
            over = terminated or truncated
        lengths.append(apart._rollout.totals.length)
    apart.close()
    for one in (env, undisturbed):
        one.step(1)
    assert same(agent.state_dict(), undisturbed._agent.state_dict())
    with task.bind() as bound:
        expected = evaluate(agent, bound, "serp", episodes=3, seed=5)
    assert tuple(lengths) == expected.lengths
