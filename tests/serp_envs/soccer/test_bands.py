"""The measured difficulty of the soccer scenarios: results of simple policies lie in bands."""

from collections import Counter
from math import atan2, hypot, pi

import numpy as np
import pytest

from serp.agent.arbiter import Arbiter
from serp.agent.registry import make_planner
from serp.settings import resolve
from serp.tasks.registry import load_task

STANDS = "stand still"


def about(goals, secured, mean_return, decisions):
    """A band around what the specification measured: what it says is "about", and sampling.

    3,000 contests are within 4 points of its shares and 0.5 of its returns. The 250 of a test
    scatter by 3 points and 0.4 more (standard errors); they are the same ones every time.
    """
    return {
        "goal": (goals - 6.0, goals + 6.0),
        "secured": (secured - 6.0, secured + 6.0),
        "return": (mean_return - 0.8, mean_return + 0.8),
        "decisions": (0.8 * decisions, 1.2 * decisions),
    }


NEVER, OFTEN = {"hits": (0.0, 0.0)}, {"hits": (1e-3, 9.0)}
# Left and right each on its own, or an error in one of them could hide in the mean of both. 1,000
# contests scatter by 1.5 points and 0.22 of a return: the bands are 3.6 of them and more.
# `frontal-contrast` is not in the specification: slowed, it wins no ball and keeps the attacker
# from the goal.
CONTEST = {
    STANDS: {**about(67.5, 0, -8.8, 10), "goal": (60, 75), "secured": (0, 0), **NEVER},
    "random": {**about(24, 20, -1.5, 25), **OFTEN},
    "always cover-goal": {**about(36, 0, -4.8, 36), "secured": (0, 1), **NEVER},
    "always side-advance left": {**about(31, 33, -1.6, 26), **NEVER},
    "always side-advance right": {**about(31, 33, -1.6, 26), **NEVER},
    "always frontal-contrast": {**about(26, 0, -4.2, 40), **NEVER},
    "always charge-opponent": {**about(16, 2, -2.2, 19), **OFTEN},
    "rule": {**about(12, 55, 3.7, 14), **NEVER},
    "planner": {"return": (0.2, 4.0), "unsafe": (0, 0)},
}  # fmt: skip
# Over 6,000 corners: return −11.3, −5.4, 4.1, 6.4; goals 95, 51, 15, 5 %. 250 corners scatter by
# 0.09, 0.5, 0.5, 0.35 and by 1.4, 3, 2, 1.4 % (standard errors).
CORNER = {
    STANDS: {"return": (-11.6, -11.0), "goal": (91, 98), "cleared": (0, 0)},
    "random": {"return": (-6.5, -4.3), "goal": (45, 58)},
    "always clear": {"return": (3.0, 5.2), "goal": (10, 20)},
    "rule": {"return": (5.6, 7.2), "goal": (2, 8)},
    "planner": {"return": (4.7, 8.1), "unsafe": (0, 0)},
}
BANDS = {"soccer": CONTEST, "corner-kick": CORNER}


def to_the_free_side(raw, info):
    """Push to the side on which the attacker is not."""
    x, y = info["ball_x"], info["ball_y"]
    mine = atan2(y - info["defender_y"], x - info["defender_x"])
    its = atan2(info["attacker_y"] - y, info["attacker_x"] - x)
    return 1 if (its - mine + pi) % (2.0 * pi) <= pi else 2


def mark_meet_clear(raw, info):
    """Mark the attacker; once the ball rolls go to meet it; within 0.5 m of it kick it away."""
    if not info["kicked"]:
        return 2
    x, y = info["defender_x"] - info["ball_x"], info["defender_y"] - info["ball_y"]
    return 4 if hypot(x, y) < 0.5 else 3


RULES = {"soccer": to_the_free_side, "corner-kick": mark_meet_clear}


def policies(task, seed):
    """By name; `STANDS` is played by a robot that is down."""
    rng = np.random.default_rng(seed)
    words = task.env.unwrapped.scenario.actions
    chosen = resolve("default", task.task.settings)
    arbiter = Arbiter(make_planner(task.model, chosen.planner), task.actions, chosen.arbiter)

    def always(action):
        return lambda raw, info: action

    return {
        STANDS: always(0),
        "random": lambda raw, info: int(rng.integers(len(words))),
        **{f"always {word}": always(action) for action, word in enumerate(words)},
        "rule": RULES[task.task.name],
        "planner": lambda raw, info: arbiter.plan(task.ground(raw)).action,
    }


def play(task, name, episodes, seed):
    """Counts (outcomes, `decisions`, `unsafe`, `hits`) and returns."""
    policy = policies(task, seed)[name]
    counts, returns = Counter[str](), []
    raw, info = task.reset(seed=seed)
    for episode in range(episodes):
        if episode:
            raw, info = task.reset()
        if name == STANDS:
            scenario = task.env.unwrapped.scenario
            scenario.world.robots[0].down_until = 10**9
        total, ended = 0.0, False
        while not ended:
            raw, reward, terminated, truncated, info = task.step(policy(raw, info))
            total += float(reward)
            counts["decisions"] += 1
            ended = terminated or truncated
        returns.append(total)
        counts[info["outcome"]] += 1
        counts["unsafe"] += info["unsafe_choices"]
        counts["hits"] += info["damaging_hits"]
    return counts, returns


@pytest.mark.parametrize(
    ("scenario", "policy"), [(task, policy) for task, bands in BANDS.items() for policy in bands]
)
def test_a_simple_policy_ends_in_its_band(scenario, policy):
    band = BANDS[scenario][policy]
    # The planner takes longer; what it is worth is measured elsewhere.
    episodes = 100 if policy == "planner" else 1000 if "side-advance" in policy else 250
    with load_task(scenario).bind() as task:
        counts, returns = play(task, policy, episodes, seed=11)
    found = {"return": float(np.mean(returns))}
    for name, count in counts.items():
        found[name] = count / episodes * (1 if name in ("decisions", "unsafe", "hits") else 100)
    missed = {
        name: found.get(name, 0.0)
        for name, (low, high) in band.items()
        if not low <= found.get(name, 0.0) <= high
    }
    assert not missed, f"{missed} of {found}"
