"""What recording, monitoring and adapting the model cost: a step, a lookahead, a training.

    python tests/benchmarks/bench_adaptation.py [--rounds N] [--env-steps N] [--only TEXT]

Wanted: monitor and adaptation together at most 15 % of a training's time. Printed, each a median of
interleaved rounds, in CPU time of one core, so that a busy machine slows all alike:

* µs of `ModelAdaptation.observe`, on the transitions of a real training, first and later;
* µs of one lookahead with the file's model and with the adapted one, which carries out the
  file's step as well, so that nothing it flags is lost;
* env steps a second of whole trainings in the preset `default`, without adaptation and with it,
  and the share of their time that `ModelAdaptation.observe` takes.

Nothing is asserted.
"""

from __future__ import annotations

import argparse
import os
import statistics
from collections.abc import Iterator
from time import process_time
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from serp._util.threads import one_thread
from serp.adaptation.adaptation import ModelAdaptation
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.lookahead import Lookahead
from serp.settings import AdaptationSettings, Settings, resolve
from serp.tasks.registry import load_task
from serp.training.trainer import Trainer

TASKS = ("cartpole", "soccer")
MODES = ("off", "residual", "full")
WANTED = 0.15
PHASES = ((0, 200), (200, 1_000), (1_000, 3_000))
STATES = 200

Step = tuple[Vector, int, Vector, bool]


def settings_of(task: str, mode: str) -> Settings:
    """The preset `default` with such an adaptation."""
    tries = 0 if mode == "off" else 3
    changes: dict[str, dict[str, Any]] = {"adaptation": {"mode": mode, "min_visits": tries}}
    return resolve("default", load_task(task).settings, changes)


def steps_of(task: str, count: int) -> tuple[TransitionModel, list[Step]]:
    """The model of a task, and what a training without adaptation saw of it."""
    with load_task(task).bind() as bound:
        trainer = Trainer(bound, settings_of(task, "off"), 0)
        while trainer.env_steps < count:
            trainer.run_episode()
        seen = trainer.agent.adaptation.experience
        columns = seen.states, seen.actions.tolist(), seen.next_states, seen.ended.tolist()
        return bound.model, list(zip(*columns, strict=True))[:count]


def new(model: TransitionModel, mode: Any, seed: int = 0) -> ModelAdaptation:
    return ModelAdaptation(model, AdaptationSettings(mode=mode), np.random.SeedSequence(seed))


# A step ----------------------------------------------------------------------------------------


def observed(model: TransitionModel, steps: list[Step], mode: str) -> Iterator[float]:
    """µs a step of `ModelAdaptation.observe` in each phase of a training."""
    adaptation = new(model, mode)
    for first, last in PHASES:
        start = process_time()
        for step in steps[first:last]:
            adaptation.observe(*step)
        yield (process_time() - start) / max(1, len(steps[first:last])) * 1e6


def print_steps(task: str, rounds: int) -> None:
    model, steps = steps_of(task, PHASES[-1][1])
    found: dict[str, list[list[float]]] = {mode: [] for mode in MODES}
    for mode in MODES:  # compiled from here on
        list(observed(model, steps[:300], mode))
    for _ in range(rounds):
        for mode in MODES:
            found[mode].append(list(observed(model, steps, mode)))
    for mode, times in found.items():
        medians = [statistics.median(phase) for phase in zip(*times, strict=True)]
        shown = "".join(f"{median:>12.0f}" for median in medians)
        print(f"  {task:<10}{mode:<24}{shown}")


# A lookahead -----------------------------------------------------------------------------------


def looked(planner: Lookahead, states: Vector) -> float:
    """µs of one lookahead."""
    start = process_time()
    for state in states:
        planner.forecast(state)
    return (process_time() - start) / len(states) * 1e6


def print_lookaheads(task: str, rounds: int) -> None:
    model, steps = steps_of(task, PHASES[-1][1])
    planner = settings_of(task, "off").planner
    states = np.array([step[0] for step in steps[-STATES:]])
    learned = {}
    for name, mode, count in (
        ("nothing learned", "residual", 0),
        ("after 50 steps", "residual", 50),
        ("after 3,000 steps", "residual", 3_000),
    ):
        learned[name] = adaptation = new(model, mode)
        for step in steps[:count]:
            adaptation.observe(*step)
    planners = {"as written": Lookahead(model, planner)}
    planners |= {name: Lookahead(of.model, planner) for name, of in learned.items()}
    times: dict[str, list[float]] = {name: [] for name in planners}
    for turn in range(rounds + 1):
        for name, of in planners.items():
            taken = looked(of, states)
            if turn:  # compiled from here on
                times[name].append(taken)
    for name, taken_by in times.items():
        ratio = statistics.median(
            own / base for own, base in zip(taken_by, times["as written"], strict=True)
        )
        print(f"  {task:<10}{name:<24}{statistics.median(taken_by):>12.0f}{ratio:>11.2f} ×")


# A training ------------------------------------------------------------------------------------


def trained(task: str, mode: str, env_steps: int, seed: int) -> tuple[float, float]:
    """Env steps a second of a training, and the share of its time that `observe` takes."""
    with load_task(task).bind() as bound:
        trainer = Trainer(bound, settings_of(task, mode), seed)
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
        wall = process_time() - start
    return trainer.env_steps / wall, spent / wall


def print_trainings(task: str, rounds: int, env_steps: int) -> None:
    for mode in MODES:  # compiled from here on
        trained(task, mode, 300, 0)
    found: dict[str, list[tuple[float, float]]] = {mode: [] for mode in MODES}
    for seed in range(rounds):
        for mode in MODES:
            found[mode].append(trained(task, mode, env_steps, seed))
    for mode, times in found.items():
        rate, share = (statistics.median(column) for column in zip(*times, strict=True))
        longer = statistics.median(
            base / own for (own, _), (base, _) in zip(times, found["off"], strict=True)
        )
        print(f"  {task:<10}{mode:<24}{rate:>12,.0f}{longer:>11.2f} ×{share:>11.1%}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--env-steps", type=int, default=3_000)
    parser.add_argument("--only", default="", help="text in the headings, such as `training`")
    arguments = parser.parse_args()
    rounds, steps = arguments.rounds, arguments.env_steps
    phases = "".join(f"{f'{first:,}-{last:,}':>12}" for first, last in PHASES)
    parts: dict[str, Any] = {
        f"  µs an observed step, of steps    {phases}": lambda t: print_steps(t, rounds),
        f"  {'a lookahead':<34}{'µs':>12}{'of written':>13}": lambda t: print_lookaheads(t, rounds),
        f"  {f'a training of {steps:,} env steps':<34}{'steps/s':>12}{'time':>13}"
        f"{'observing':>11}": lambda t: print_trainings(t, rounds, steps),
    }
    with one_thread():
        for heading, part in parts.items():
            if arguments.only in heading:
                print(heading)
                for task in TASKS:
                    part(task)
                print()
    print(f"medians of {rounds} interleaved rounds; wanted: observing ≤ {WANTED:.0%} of a training")


if __name__ == "__main__":
    main()
