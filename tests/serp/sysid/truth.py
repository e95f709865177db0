"""A small world whose domain file is partly wrong, and what was seen of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from serp import load_domain
from serp.diagnosis.findings import (
    EffectTerm,
    Findings,
    MissingEffect,
    ObservedOutcome,
    ParameterFinding,
    StochasticEffect,
)
from serp.diagnosis.patched_model import forecast_with
from serp.diagnosis.recorded_run import Recorded
from serp.model.loading import Domain
from serp.model.transition_model import TransitionModel, Vector
from serp.sysid.monitor import Monitor
from serp.sysid.regression_data import predicted_steps
from serp.sysid.transitions import GOES_ON, OVER, TransitionMemory

ROBOTS = """(define (domain robots)
  (:requirements :typing :numeric-fluents :time)
  (:types robot)
  (:constants r1 r2 - robot)
  (:predicates (lit ?r - robot))
  (:functions (place ?r - robot) (battery ?r - robot) (warmth))
  (:action drive
    :parameters (?r - robot)
    :precondition (and)
    :effect (and
      (increase (place ?r) 1.5)
      (decrease (battery ?r) (+ 0.2 (* 0.1 (place ?r))))))
  (:action light
    :parameters (?r - robot)
    :precondition (and)
    :effect (and (lit ?r)))
  (:process cool
    :parameters ()
    :precondition (and)
    :effect (and (decrease (warmth) (* #t (* 0.5 (warmth)))))))
"""


def robots(folder: Path, dt: float = 0.5) -> TransitionModel:
    """The model of the file as written."""
    file = folder / "robots.pddl"
    file.write_text(ROBOTS, encoding="utf-8")
    return load_domain(file).model.replace(dt=dt)


def states_of(
    model: TransitionModel, count: int, seed: int = 0
) -> tuple[Vector, NDArray[np.int64]]:
    """States and actions drawn at random."""
    rng = np.random.default_rng(seed)
    states = rng.normal(size=(count, len(model.fluents)))
    for fluent in model.fluents:
        if not fluent.numeric:
            states[:, fluent.index] = rng.integers(2, size=count)
    return states, rng.integers(len(model.actions), size=count)


def recorded(
    model: TransitionModel,
    states: Vector,
    actions: NDArray[np.int64],
    next_states: Vector,
    rewards: Vector | None = None,
    over: NDArray[np.bool_] | None = None,
    domain: Domain | None = None,
) -> Recorded:
    """What a run would have recorded of these steps, by default as the file rewards and ends."""
    experience = TransitionMemory(len(states), states.shape[1], len(model.actions))
    monitor = Monitor(model)
    written = predicted_steps(model, states, actions)
    rewards = written[:, -2] if rewards is None else rewards
    over = written[:, -1] != 0.0 if over is None else over
    endings = np.where(over, OVER, GOES_ON)
    after = np.column_stack((next_states, rewards, over))
    for k, (action, predicted) in enumerate(zip(actions.tolist(), written, strict=True)):
        experience.add(states[k], action, next_states[k], int(endings[k]), rewards[k])
        monitor.observe(states[k], action, np.stack([predicted, predicted, after[k]]))
    file = model.actions[0].place.source.name
    return Recorded(
        run=Path("runs/seven"),
        domain=domain or load_domain(file),
        files={"domain.pddl": file},
        model=model,
        experience=experience,
        monitor=monitor,
        env_steps=len(states),
        learned_from="environment",
        notice=None,
    )


def literal(
    model: TransitionModel,
    index: int,
    estimate: float,
    *,
    fluent: str = "place",
    schema: str = "drive",
    error: float = 0.02,
    cost: float = 1.0,
) -> ParameterFinding:
    parameter = model.parameters[index]
    return ParameterFinding(
        parameter, schema, fluent, parameter.value, estimate, error, samples=412, cost=cost
    )


def missing(
    model: TransitionModel,
    fluent: str,
    terms: Mapping[tuple[str, ...], float],
    *,
    schema: str = "drive",
    rate: bool = False,
    cost: float = 1.0,
) -> MissingEffect:
    place = next((a.place for a in model.actions if a.schema == schema), None)
    summands = tuple(EffectTerm(value, 0.02, fluents) for fluents, value in terms.items())
    return MissingEffect(schema, place, fluent, summands, rate, samples=412, cost=cost)


def chances(
    model: TransitionModel,
    schema: str,
    *outcomes: tuple[dict[str, float], float, bool],
    cost: float = 1.0,
) -> StochasticEffect:
    place = next(a.place for a in model.actions if a.schema == schema)
    told = tuple(ObservedOutcome(tuple(c.items()), p, 0.02, written) for c, p, written in outcomes)
    return StochasticEffect(schema, place, told, samples=412, cost=cost)


def found(*kinds: ParameterFinding | MissingEffect | StochasticEffect) -> Findings:
    """Findings of these kinds."""
    return Findings(
        parameters=tuple(f for f in kinds if isinstance(f, ParameterFinding)),
        missing=tuple(f for f in kinds if isinstance(f, MissingEffect)),
        stochastic=tuple(f for f in kinds if isinstance(f, StochasticEffect)),
        rules=(), samples=0, skipped=0,
    )  # fmt: skip


def predictions_with(
    model: TransitionModel, findings: Findings, states: Vector, actions: NDArray[np.int64]
) -> Vector:
    """The next states `[N, F]` to be expected with all findings taken into account."""
    return forecast_with(model, findings, states, actions).mean[:, :-2]
