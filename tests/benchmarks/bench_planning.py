"""What one replan costs: array lookahead, planning graph, unified-planning's simulator.

    python tests/benchmarks/bench_planning.py [--rounds N]

Depth 5; three actions on a cart-pole-like domain, five on the shipped soccer domain. All contenders
take turns in short rounds on the same states, so that a busy machine slows all alike; medians and
ratios are printed beside the targets. Nothing is asserted.

The simulator knows neither processes nor events; for the comparison with it the cart-pole-like
dynamics stand in the effects of the actions, and both plan over that same file. What is timed of it
is the same search as plain recursion over `SequentialSimulator.apply`.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from serp.model.loading import load_domain
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.lookahead import Lookahead
from serp.planning.replanner import MonitorReplanner
from serp.settings import PlannerSettings
from serp.tasks.registry import load_task

DEPTH, DISCOUNT = 5, 0.99

CARTPOLE = """
(define (domain cartpole-like)
  (:predicates (unsafe) (terminal))
  (:functions (position) (velocity) (angle) (spin) (reward))
  (:action left :parameters () :precondition (and)
    :effect (and (decrease (velocity) 0.195) (increase (spin) 0.29)))
  (:action coast :parameters () :precondition (and)
    :effect (and (decrease (reward) 0.001)))
  (:action right :parameters () :precondition (and)
    :effect (and (increase (velocity) 0.195) (decrease (spin) 0.29)))
  (:process roll :parameters () :precondition (and)
    :effect (and (increase (position) (* #t (velocity)))))
  (:process swing :parameters () :precondition (and)
    :effect (and (increase (angle) (* #t (spin)))))
  (:process gravity :parameters () :precondition (and)
    :effect (and (increase (spin) (* #t (* 15.8 (angle))))))
  (:event balance :parameters () :precondition (and)
    :effect (and (increase (reward) (- 1.0 (* (angle) (* 14.6 (angle)))))))
  (:event centre :parameters () :precondition (and)
    :effect (and (decrease (reward) (* 0.05 (* (position) (position))))))
  (:event fall :parameters ()
    :precondition (and (or (> (angle) 0.2618) (< (angle) -0.2618)
                           (> (position) 2.4) (< (position) -2.4)))
    :effect (and (unsafe) (terminal) (decrease (reward) 1.0))))
"""

CARTPOLE_STATES = {
    "position": (-1.0, 1.0),
    "velocity": (-0.5, 0.5),
    "angle": (-0.05, 0.05),
    "spin": (-0.3, 0.3),
}
SOCCER_STATES = {
    "robot-to-ball": (0.9, 1.5),
    "opponent-to-ball": (0.4, 0.9),
    "robot-to-opponent": (0.9, 1.6),
    "off-line": (0.0, 1.2),
    "goal-open": (0.0, 0.3),
}

EFFECTS_ONLY = """
(define (domain cartpole-in-effects)
  (:requirements :typing :numeric-fluents :conditional-effects :disjunctive-preconditions)
  (:predicates (unsafe))
  (:functions (position) (velocity) (angle) (spin) (reward))
{actions})
"""
ONE_ACTION = """
  (:action {name} :parameters () :precondition (and)
    :effect (and
      (increase (position) (* 0.02 (+ (velocity) {push})))
      (increase (velocity) {push})
      (increase (angle) (* 0.02 (- (spin) {swing})))
      (increase (spin) (- (* 0.316 (angle)) {swing}))
      (increase (reward) (- 1.0 (* (angle) (* 14.6 (angle)))))
      (when (or (> (angle) 0.2618) (< (angle) -0.2618)) (unsafe))))"""
PROBLEM = """
(define (problem start) (:domain cartpole-in-effects)
  (:init (= (position) 0.1) (= (velocity) 0.2) (= (angle) 0.03) (= (spin) -0.1) (= (reward) 0))
  (:goal (and (unsafe))))
"""


def effects_only() -> str:
    pushes = (("left", "-0.195", "-0.29"), ("coast", "0.0", "0.0"), ("right", "0.195", "0.29"))
    actions = "".join(ONE_ACTION.format(name=n, push=p, swing=s) for n, p, s in pushes)
    return EFFECTS_ONLY.format(actions=actions)


# Contenders ------------------------------------------------------------------------------------


@dataclass
class Contender:
    """Something to time; `seconds` collects the time of single calls."""

    name: str
    call: Callable[[], Any]
    calls: int
    seconds: list[float] = field(default_factory=list)

    def measure(self) -> None:
        start = perf_counter()
        for _ in range(self.calls):
            self.call()
        self.seconds.append((perf_counter() - start) / self.calls)

    @property
    def median(self) -> float:
        return statistics.median(self.seconds)

    def shown(self) -> str:
        return f"{shown(self.median)} ({shown(min(self.seconds))})"


def interleaved(contenders: Sequence[Contender], rounds: int) -> None:
    for contender in contenders:
        contender.call()  # compiled, allocated, imported
    for _ in range(rounds):
        for contender in contenders:
            contender.measure()


def load(folder: Path, name: str, domain: str, problem: str | None = None) -> TransitionModel:
    file = folder / f"{name}.pddl"
    file.write_text(domain, encoding="utf-8")
    if problem is not None:
        (folder / f"{name}-problem.pddl").write_text(problem, encoding="utf-8")
    return load_domain(file).model


def states_of(model: TransitionModel, ranges: Mapping[str, tuple[float, float]]) -> Vector:
    """64 states, numbers drawn between their bounds, predicates false: nothing ends at once."""
    rng = np.random.default_rng(0)
    states = [
        {f.name: rng.uniform(*ranges[f.name]) if f.numeric else False for f in model.fluents}
        for _ in range(64)
    ]
    return np.array([model.state(values) for values in states])


def planners(model: TransitionModel, states: Vector) -> dict[str, Contender]:
    settings = PlannerSettings(depth=DEPTH, discount=DISCOUNT)
    lookahead = Lookahead(model, settings)
    replanner = MonitorReplanner(model, depth=DEPTH, discount=DISCOUNT)
    rows = cycle(states)
    return {
        "single": Contender("lookahead", lambda: lookahead.forecast(next(rows)), 500),
        "plan": Contender("planning graph: plan", lambda: replanner.plan(next(rows)), 20),
        "graph": Contender("the same, as networkx", lambda: replanner.plan(next(rows)).graph, 10),
    }


def simulator(domain: Path, problem: Path) -> Callable[[], str]:
    """One replan with unified-planning's simulator."""
    from unified_planning.engines.sequential_simulator import (
        UPSequentialSimulator as SequentialSimulator,
    )
    from unified_planning.io import PDDLReader
    from unified_planning.shortcuts import get_environment

    get_environment().credits_stream = None
    task = PDDLReader().parse_problem(str(domain), str(problem))
    steps = SequentialSimulator(task, error_on_failed_checks=False)
    reward = task.fluent("reward")()
    unsafe = task.fluent("unsafe")()
    root = steps.get_initial_state()

    def best(state: Any, earned: Any, depth: int) -> tuple[int, float, str]:
        """Safe steps, value and first action of the best path."""
        found = (-1, 0.0, "")
        for action in task.actions:
            after = steps.apply(state, action)
            if after is None:
                continue
            total = after.get_value(reward).constant_value()
            if after.get_value(unsafe).is_true():
                rated = (0, float(total - earned), action.name)
            elif depth == 1:
                rated = (1, float(total - earned), action.name)
            else:
                ahead, value, _ = best(after, total, depth - 1)
                rated = (ahead + 1, float(total - earned) + DISCOUNT * value, action.name)
            if rated[:2] > found[:2]:
                found = rated
        return found

    return lambda: best(root, 0, DEPTH)[2]


# Report ----------------------------------------------------------------------------------------


def shown(seconds: float) -> str:
    return f"{seconds * 1e6:,.1f} µs" if seconds < 1e-2 else f"{seconds * 1e3:,.1f} ms"


def row(name: str, measured: str, target: str = "") -> None:
    print(f"  {name:<42}{measured:>26}   {target}")


def report(title: str, found: dict[str, Contender], targets: tuple[str, str]) -> None:
    edges = found["graph"].call().number_of_edges()
    print(f"{title}, {edges:,} edges")
    row("lookahead", found["single"].shown(), f"target: ≤ {targets[0]}")
    row("planning graph (plan)", found["plan"].shown(), f"target: ≤ {targets[1]}")
    row("planning graph and its networkx form", found["graph"].shown())
    print()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=15)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cartpole = load(folder, "cartpole", CARTPOLE).replace(dt=0.02)
        soccer = load_task("soccer").load().model.replace(dt=0.4)
        effects = load(folder, "effects", effects_only(), PROBLEM)
        found = {
            "cart": planners(cartpole, states_of(cartpole, CARTPOLE_STATES)),
            "soccer": planners(soccer, states_of(soccer, SOCCER_STATES)),
        }
        start = effects.initial_state
        assert start is not None
        ours = Lookahead(effects, PlannerSettings(depth=DEPTH, discount=DISCOUNT))
        theirs = simulator(folder / "effects.pddl", folder / "effects-problem.pddl")
        chosen = effects.actions[ours.forecast(start).choice].name
        assert theirs() == chosen, "both have to find the same plan"
        fast = Contender("lookahead", lambda: ours.forecast(start), 500)
        slow = Contender("simulator", theirs, 1)
        interleaved([c for group in found.values() for c in group.values()], arguments.rounds)
        interleaved([fast, slow], max(3, arguments.rounds // 3))
    print(
        f"One replan, depth {DEPTH}, medians of {arguments.rounds} interleaved rounds"
        " (fastest round)\n"
    )
    report("Cart-pole-like, 3 actions", found["cart"], ("30 µs", "0.8 ms"))
    report("Soccer, 5 actions", found["soccer"], ("150 µs", "9 ms"))
    print("Cart-pole-like in effects, 3 actions, against unified-planning's SequentialSimulator")
    row("lookahead", fast.shown())
    row("simulator", slow.shown())
    row("ratio", f"{slow.median / fast.median:,.0f} ×", "target: ≥ 5,000")


if __name__ == "__main__":
    main()
