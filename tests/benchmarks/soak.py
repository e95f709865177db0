"""A soak: random worlds, random settings, and every executed action judged again.

    python -m tests.benchmarks.soak [--decisions 1000000] [--first 0] [--jobs 2]

A world is a random domain file that starts in a random state, with failures, slips and noise. A
training has a random preset, strategy, planner, kind of adaptation, horizon of vetoes, number of
environments and learner. `tests.generated.oracle`, which reads the file as written and shares only
the parser with serp, judges each decision again: an action that it flags may be executed only where
it flags every action that has a result. Printed are decisions, flagged ones and violations; the
exit status is 1 where there is a violation or an unexpected error. A world is named by its number:
`--first N --decisions 1` repeats it.
"""

from __future__ import annotations

import argparse
import sys
import traceback
import warnings
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from random import Random
from typing import Any, Final

import numpy as np

from serp.errors import SerpError
from serp.runs.trainer import Trainer
from serp.settings import Settings, resolve
from serp.tasks.file_world import WorldOptions, starting, world_task
from tests.generated import FULL, PLANNABLE, Generated, load_texts, write_texts

STEPS: Final = 400
"""Env steps of a training, at least."""


def settings_of(random: Random) -> Settings:
    """Return random settings that train fast."""
    chance = random.choice
    learner = {
        "hidden": chance(([8], [16, 16])), "members": chance((1, 2)), "batch_size": 8,
        "layer_norm": chance((False, True)), "n_step": chance((1, 3)), "learning_starts": 50,
        "target_polyak": chance((None, 0.01)), "epsilon_steps": chance((0, 200)),
    }  # fmt: skip
    changes: dict[str, Any] = {
        "planner": {
            "name": chance(("far-sight", "lookahead")),
            "depth": random.randint(1, 4), "max_nodes": chance((3, 200)),
            "accepted_risk": chance((0.0, 0.02, 0.3)), "discount": chance((0.8, 0.99)),
        },
        "adaptation": {"mode": chance(("off", "parameters", "residual", "full"))},
        "arbiter": {
            "veto_horizon": chance(("step", "lookahead")), "r_min": chance((None, -1.0)),
        },
        "guide": {"strategy": chance(("mixture", "evidence"))},
        "learner": learner,
        "training": {"random_steps": chance((0, 60)), "episode_steps": 40},
    }  # fmt: skip
    return resolve(chance(("default", "paper")), None, changes)


def judge(generated: Generated, dt: float, step: Any) -> Counter[str]:
    """Return counts of a step: whether it was flagged, and whether another action was not."""
    names = [action.name for action in generated.model.actions]
    state = generated.spelled(step.state)

    def flagged(action: str) -> bool | None:
        """Return whether the file flags an action; None where it has no result."""
        prediction = generated.oracle.step(state, action, dt)
        return prediction.unsafe if prediction.applicable else None

    executed = names[int(step.decision.forecast.ground[step.decision.action])]
    if not flagged(executed):
        return Counter(decisions=1)
    avoidable = any(flagged(name) is False for name in names if name != executed)
    return Counter(decisions=1, flagged=1, violations=avoidable)


def soak(number: int) -> Counter[str]:
    """Train in the world of a number; return counts."""
    warnings.simplefilter("ignore")
    random = Random(number)
    texts = write_texts(random, random.choice((FULL, PLANNABLE)))
    dt = random.choice((0.5, 1.0))
    try:
        domain = load_texts(texts)
        if not domain.model.actions:
            return Counter({"without actions": 1})
        start = {
            f.name: random.randint(-8, 8) / 4 if f.numeric else random.random() < 0.5
            for f in domain.model.fluents
        }
        domain = starting(domain, start)
        options = WorldOptions(
            failure=random.choice((0.0, 0.1)), slip=random.choice((0.0, 0.1)),
            noise=random.choice((0.0, 0.2)), max_steps=40,
        )  # fmt: skip
        with world_task(domain, options, dt).bind() as bound:
            world, counts = Generated(texts, domain.closed()), Counter(worlds=1)
            with Trainer(bound, settings_of(random), number) as trainer, np.errstate(all="ignore"):
                trainer.on_step = lambda step: counts.update(judge(world, dt, step))
                while trainer.env_steps < STEPS:
                    for _ in trainer.run():
                        pass
    except SerpError as error:  # a world without result, or one that cannot be trained in
        return Counter({f"refused: {type(error).__name__}": 1})
    return counts


def main() -> int:
    """Run worlds until there are enough decisions."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--decisions", type=int, default=1_000_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    counts: Counter[str] = Counter()
    number, failed = given.first, False
    with ProcessPoolExecutor(given.jobs, get_context("spawn")) as pool:
        while counts["decisions"] < given.decisions and not failed:
            part = range(number, number + (1 if given.decisions == 1 else 100))
            jobs = {pool.submit(soak, each): each for each in part}
            for job in as_completed(jobs):
                if error := job.exception():
                    failed = True
                    print(f"world {jobs[job]}:", file=sys.stderr)
                    traceback.print_exception(error)
                elif job.result()["violations"]:
                    failed = True
                    print(f"world {jobs[job]}: {dict(job.result())}", file=sys.stderr)
                counts += Counter() if error else job.result()
            number = part.stop
            print(f"to world {number - 1}: {dict(counts)}", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
