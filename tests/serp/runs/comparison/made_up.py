"""Records of trials that never ran, for tests of what is done with records."""

from __future__ import annotations

import numpy as np

from serp.runs.comparison.plan import (
    EPISODE_COLUMNS,
    EVALUATION_COLUMNS,
    ComparisonPlan,
    ComparisonProtocol,
    Record,
    Trial,
)
from serp.runs.comparison.request import ComparisonMetadata


def record(
    returns,
    lengths=None,
    *,
    trial=("serp", "base", 0),
    evaluations=(),
    outcomes=None,
    unsafe=0,
    info=None,
    metadata=None,
):
    """A record of episodes with these returns.

    evaluations: (env steps, policy, return) an episode; unsafe: in the first episode.
    """
    count = len(returns)
    lengths = [10] * count if lengths is None else lengths
    ends = np.cumsum(lengths)
    first = [unsafe] + [0] * (count - 1) if count else []
    columns = {
        "episode": np.arange(1, count + 1),
        "env_steps": ends.astype(int),
        "return": np.array(returns, float),
        "learner_return": np.array(returns, float),
        "length": np.array(lengths, int),
        "terminated": np.ones(count, bool),
        "outcome": np.array([""] * count if outcomes is None else outcomes, dtype=np.str_),
        "unsafe": np.array(first, int),
        "avoidable_unsafe": np.array(first, int),
        "unsafe_observed": np.array(first, int),
        "vetoes": np.zeros(count, int),
        "planner_steps": np.array(lengths, int) // 2,
        "seconds": ends / 1000,
    }
    assert tuple(columns) == EPISODE_COLUMNS
    columns |= {f"info.{name}": np.array(values, float) for name, values in (info or {}).items()}
    rows = [
        (steps, policy, number + 1, value, 10, True, "", 0, 0)
        for number, (steps, policy, value) in enumerate(evaluations)
    ]
    kinds = (int, np.str_, int, float, int, bool, np.str_, int, int)
    cells = list(zip(*rows, strict=True)) or [()] * len(kinds)
    found = {
        name: np.array(values, dtype=kind)
        for name, values, kind in zip(EVALUATION_COLUMNS, cells, kinds, strict=True)
    }
    return Record(
        Trial(*trial),
        columns,
        found,
        {"characteristics": {"planner": "lookahead"}, **(metadata or {})},
    )


def trial(algorithm, seed, level, *, variant="base", planner=None, spread=5.0, episodes=60, **more):
    """A record of an algorithm that plays at a level from its first episode to its last."""
    rng = np.random.default_rng([seed, len(algorithm), len(variant)])
    own = level + rng.normal(0, spread)
    checkpoints = [
        (steps, "learner", own + float(rng.normal(0, 1)))
        for steps in (200, 400, 600)
        for _ in range(7)  # enough for a threshold
        if algorithm != "mrp"
    ]
    if planner is not None:
        checkpoints += [(600, "planner", planner + float(rng.normal())) for _ in range(3)]
    return record(
        rng.normal(own, 1, episodes).tolist(),
        trial=(algorithm, variant, seed),
        evaluations=checkpoints,
        **more,
    )


LEVELS = {"serp": 90.0, "mrp": 50.0, "dqn": 30.0}


def records(seeds=range(4), levels=LEVELS, **more):
    """Trials of some algorithms, each at its level."""
    return [
        trial(name, seed, level, planner=50.0 if name == "mrp" else None, **more)
        for name, level in levels.items()
        for seed in seeds
    ]


def metadata(found, **more):
    """A comparison that was asked for these records."""
    plan = {
        "task": "walkway",
        "algorithms": {r.trial.algorithm: {} for r in found},
        "variants": tuple(dict.fromkeys(["base", *(r.trial.variant for r in found)])),
        "trials": tuple(r.trial for r in found),
        "protocol": ComparisonProtocol(
            env_steps=600, evaluate_every=200, evaluation_episodes=7, final_episodes=7
        ),
        "changes": {},
        "threshold": 80.0,
        "max_ground_schemas": 1000,
    }
    plan |= {name: more.pop(name) for name in list(more) if name in plan}
    about = {
        "rewarded_by": "domain",
        "command": "serp compare --domain walkway",
        "machine": {"cores": 2},
        "versions": {"serp": "1"},
    }
    return ComparisonMetadata(plan=ComparisonPlan(**plan), **{**about, **more})
