"""Records of env steps that were never made."""

from typing import Any

import numpy as np

from serp.agent.decision import Actor, Decision, Reason
from serp.agent.step_record import EpisodeTotals, StepRecord
from tests.serp.agent.scene import forecast

DECISION = Decision(
    action=0,
    executed_by=Actor.LEARNER,
    reason=Reason.ACCEPTED,
    proposed=0,
    proposed_by=Actor.LEARNER,
    rho=0.5,
    admissible=np.ones(1, bool),
    forecast=forecast([0.0]),
)  # fmt: skip


def step_record(decision: Decision = DECISION, **given: Any) -> StepRecord:
    """Return the record of a step; `x` stands for the state, `reward` for every reward."""
    reward = given.pop("reward", 0.0)
    state = np.asarray(given.pop("state", np.zeros(1)), dtype=float)
    following = np.asarray(given.pop("next_state", state), dtype=float)
    step = StepRecord(
        number=1,
        observation=state,
        state=state,
        x=state,
        decision=decision,
        reward=reward,
        domain_reward=reward,
        env_reward=reward,
        unsafe=False,
        unsafe_observed=False,
        next_state=following,
        next_x=following,
        terminated=False,
        truncated=False,
        info={},
        episode=EpisodeTotals(),
    )
    return step._replace(**given)
