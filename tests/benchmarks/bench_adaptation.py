"""What recording and adapting the model cost in a training.

    python tests/benchmarks/bench_adaptation.py [--rounds N] [--env-steps N]

Wanted: at most 15 % of a training's time. Printed, as medians of interleaved rounds in CPU time of
one core: env steps a second of trainings in the preset `default`, without adaptation and with it,
and the share of their time that `ModelAdaptation.observe` takes. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import os
import statistics
from time import process_time
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from serp._util.threads import one_thread
from serp.settings import resolve
from serp.tasks.registry import load_task
from serp.training.trainer import Trainer

TASKS = ("cartpole", "soccer")
MODES = ("off", "residual", "full")


def trained(task: str, mode: str, env_steps: int, seed: int) -> tuple[float, float]:
    """Env steps a second of a training, and the share of its time that `observe` takes."""
    changes = {"adaptation": {"mode": mode, "min_visits": 0 if mode == "off" else 3}}
    with load_task(task).bind() as bound:
        trainer = Trainer(bound, resolve("default", bound.task.settings, changes), seed)
        adaptation, spent = trainer.agent.adaptation, 0.0
        observe = adaptation.observe

        def timed(*step: Any) -> None:
            nonlocal spent
            began = process_time()
            observe(*step)
            spent += process_time() - began

        adaptation.observe = timed  # type: ignore[method-assign]
        start = process_time()
        while trainer.env_steps < env_steps:
            trainer.run_episode()
        taken = process_time() - start
    return trainer.env_steps / taken, spent / taken


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--env-steps", type=int, default=3_000)
    options = parser.parse_args()
    print(f"{'':20}{'env steps/s':>12}{'observing':>11}   medians of {options.rounds} rounds")
    with one_thread():
        for task in TASKS:
            found: dict[str, list[tuple[float, float]]] = {mode: [] for mode in MODES}
            for mode in MODES:
                trained(task, mode, 300, 0)  # compiled from here on
            for seed in range(options.rounds):
                for mode in MODES:
                    found[mode].append(trained(task, mode, options.env_steps, seed))
            for mode, times in found.items():
                rate, share = (statistics.median(column) for column in zip(*times, strict=True))
                print(f"{task:<10}{mode:<10}{rate:>12,.0f}{share:>11.1%}")


if __name__ == "__main__":
    main()
