"""Records of trials that never ran, for tests of what is done with records."""

import numpy as np

from serp.runs.comparison.compare import ComparisonPlan
from serp.runs.comparison.trial import Record, Trial, TrialProtocol

LEVELS = {"serp": 90.0, "mrp": 50.0, "dqn": 30.0}


def record(
    returns, lengths = None, *,
    trial = ("serp", 0),
    evaluations = (), outcomes = (),
    slips = (), unsafe = 0,
):  # fmt: skip
    """A record of episodes with these returns; outcomes and counters are of the last evaluations.

    evaluations: (env steps, policy, return) an episode; unsafe: in the first episode.
    """
    count = len(returns)
    steps = np.array([10] * count if lengths is None else lengths, dtype=int)
    first = np.eye(1, count, dtype=int)[0] * unsafe if count else np.zeros(0, int)
    episodes = {
        "env_steps": steps.cumsum(),
        "return": np.array(returns, float),
        "length": steps,
        "terminated": np.ones(count, bool),
        "unsafe_executed": first,
        "avoidable_unsafe": first.astype(float),
        "unsafe_observed": first.astype(float),
        "vetoes": np.zeros(count, int),
        "planner_steps": steps // 2,
        "wall_time": steps.cumsum() / 1000,
    }
    rows = len(evaluations)
    table = {
        "env_steps": np.array([row[0] for row in evaluations], float),
        "policy": np.array([row[1] for row in evaluations], np.str_),
        "return": np.array([row[2] for row in evaluations], float),
        "outcome": np.array([*[""] * (rows - len(outcomes)), *outcomes], np.str_),
        "unsafe_observed": np.zeros(rows),
    }
    if slips:
        table["info.slips"] = np.array([*[0.0] * (rows - len(slips)), *slips])
    return Record(Trial(*trial), episodes, table, {"serp": "1"})


def records(seeds=range(4)):
    """Trials of some algorithms, each at its level from its first episode to its last."""
    found = []
    for name, level in LEVELS.items():
        for seed in seeds:
            rng = np.random.default_rng([seed, len(name), 4])
            own = level + float(rng.normal(0, 5))
            rows = [(at, "learner", own) for at in (200, 400, 600)] if name != "mrp" else []
            rows += [(600, "policy", own)] if name != "dqn" else []
            returns = rng.normal(own, 1, 60).tolist()
            found.append(record(returns, trial=(name, seed), evaluations=rows))
    return found


def plan_of(found, **more):
    """The plan of a comparison with these records."""
    plan = {
        "task": "walkway",
        "algorithms": tuple(dict.fromkeys(r.trial.algorithm for r in found)),
        "seeds": tuple(sorted({r.trial.seed for r in found})),
        "protocol": TrialProtocol(env_steps=600, evaluate_every=200),
        "settings": {},
        "threshold": 80.0,
    }
    return ComparisonPlan(**{**plan, **more})
