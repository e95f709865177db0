"""A small world whose domain file is partly wrong, and what was seen of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from serp import load_domain
from serp.correction.experience import Experience
from serp.correction.findings import (
    Findings,
    FluentFit,
    LiteralFinding,
    MissingEffect,
    Outcome,
    OutcomeFinding,
    Term,
)
from serp.correction.monitor import Monitor
from serp.correction.recorded import Recorded
from serp.correction.sample import predictions
from serp.domain.model import TransitionModel, Vector

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
    model: TransitionModel, states: Vector, actions: NDArray[np.int64], next_states: Vector
) -> Recorded:
    """What a run would have recorded of these steps."""
    experience = Experience(len(states), states.shape[1], len(model.actions))
    monitor = Monitor(model)
    written = predictions(model, states, actions)
    for step in zip(states, actions.tolist(), next_states, written, strict=True):
        experience.add(*step[:3], False)
        monitor.observe(step[0], step[1], step[3], step[3], step[2])
    file = model.actions[0].place.source.name
    return Recorded(
        run=Path("runs/seven"), domain=load_domain(file), files={"domain.pddl": file}, model=model,
        experience=experience, monitor=monitor, env_steps=len(states), notice=None,
    )  # fmt: skip


def literal(
    model: TransitionModel,
    index: int,
    estimate: float,
    *,
    fluent: str = "place",
    schema: str = "drive",
    error: float = 0.02,
    cost: float = 1.0,
) -> LiteralFinding:
    parameter = model.parameters[index]
    return LiteralFinding(
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
    summands = tuple(Term(value, 0.02, fluents) for fluents, value in terms.items())
    return MissingEffect(schema, place, fluent, summands, rate, samples=412, cost=cost)


def chances(
    model: TransitionModel,
    schema: str,
    *outcomes: tuple[dict[str, float], float, bool],
    cost: float = 1.0,
) -> OutcomeFinding:
    place = next(a.place for a in model.actions if a.schema == schema)
    told = tuple(Outcome(tuple(c.items()), p, 0.02, written) for c, p, written in outcomes)
    return OutcomeFinding(schema, place, told, samples=412, cost=cost)


def found(*kinds: LiteralFinding | MissingEffect | OutcomeFinding) -> Findings:
    """Findings without fits."""
    return Findings(
        literals=tuple(f for f in kinds if isinstance(f, LiteralFinding)),
        missing=tuple(f for f in kinds if isinstance(f, MissingEffect)),
        outcomes=tuple(f for f in kinds if isinstance(f, OutcomeFinding)),
        fits=(), samples=0, skipped=0,
    )  # fmt: skip


def fitted(
    findings: Findings,
    model: TransitionModel,
    states: Vector,
    actions: NDArray[np.int64],
    next_states: Vector,
    estimated: Vector,
) -> Findings:
    """The same findings with the fits that belong to them."""
    written = predictions(model, states, actions)
    scale = np.ptp(np.concatenate((states, next_states)), axis=0)
    fits = [
        FluentFit(
            action.name, fluent.name, *(_rmse(p, next_states, actions == k, fluent.index)
                                        for p in (written, estimated)),
            scale=float(scale[fluent.index]), samples=int((actions == k).sum()),
        )
        for k, action in enumerate(model.actions)
        for fluent in model.fluents
    ]  # fmt: skip
    return dataclasses.replace(findings, fits=tuple(fits), samples=len(states))


def _rmse(predicted: Vector, observed: Vector, rows: NDArray[np.bool_], column: int) -> float:
    return float(np.sqrt(np.mean((observed - predicted)[rows, column] ** 2)))
