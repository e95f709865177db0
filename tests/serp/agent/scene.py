"""A planner's view and a learner whose values are known, to see what a strategy makes of both."""

import numpy as np

from serp.agent.decision import Actor, Decision, Reason
from serp.agent.step_record import EpisodeTotals, StepRecord
from serp.agent.strategy import Situation
from serp.learning.dqn import Proposal
from serp.model.flags import APPLICABLE
from serp.planning.forecast import SAFE, Bound
from serp.tasks.action_map import ActionForecast


def forecast(values):
    """What the planner thinks of actions that are all applicable and safe."""
    value = np.array(values, dtype=np.float64)
    count = len(value)
    return ActionForecast(
        choice=int(value.argmax()),
        ground=np.arange(count),
        value=value,
        path_risk=np.zeros(count),
        safe_steps=np.full(count, SAFE),
        reward=np.zeros(count),
        flags=np.full(count, APPLICABLE),
        depth=1,
        bound=Bound.DEPTH,
        indifferent=count > 1 and bool((value == value[0]).all()),
    )


def situation(values):
    """A state in which the plans from each action on are worth so much; no veto refuses one."""
    return Situation(np.zeros(1), forecast(values), np.ones(len(values), bool))


def decided(values, action, by=Actor.LEARNER):
    """A decision for an action in such a state."""
    scene = situation(values)
    return Decision(action, by, Reason.ACCEPTED, action, by, 1.0, *scene.record)


def step(decision, reward=0.0, state=0.0, after=0.0, terminated=False, truncated=False):
    """A step after a decision, in a state of one fluent."""
    before, then = np.array([float(state)]), np.array([float(after)])
    return StepRecord(
        1, before, before, before, decision, reward, 0.0, reward, False, False, then, then,
        terminated, truncated, {}, EpisodeTotals(),
    )  # fmt: skip


class Known:
    """A learner whose values are given; it never explores."""

    def __init__(self, q):
        self.q = np.array(q, dtype=np.float32)

    def propose(self, explorable):
        return self.propose_greedily()

    def propose_greedily(self):
        return Proposal(int(self.q.argmax()), False)

    def values(self):
        return self.q[None]


def learner_acts(strategy):
    """Whether the learner is asked next, all else equal."""
    return strategy.propose(situation([1.0, 0.0]), Known([0.0, 1.0])) is not None
