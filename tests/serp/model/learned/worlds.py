"""Small worlds whose domain files leave something out, and arbitrary adaptations of any model."""

import functools
from random import Random
from typing import Any

import numpy as np

from serp._core import OutcomeTable
from serp.model.domain import load_domain
from serp.model.learned.adaptation import ModelAdaptation
from serp.model.learned.adapted_model import AdaptedModel
from serp.model.learned.feature_groups import CURVED, FEATURES, FILE, FULL, LINEAR
from serp.settings import AdaptationSettings
from tests.generated import PLANNABLE, generate
from tests.serp.model.learned.rolls import from_text
from tests.worlds import DOMAINS

PLANE = """(define (domain plane)
  (:functions (p) (v))
  (:action push :parameters () :precondition (and) :effect (and))
  (:action rest :parameters () :precondition (and) :effect (and))
  (:process move :parameters () :precondition (and)
    :effect (and (increase (p) (* #t (v))))))
"""
"""A mass that is pushed or not; the file knows that it moves as fast as it is."""

ICE = """(define (domain ice)
  (:predicates (icy))
  (:functions (p) (v))
  (:action push :parameters () :precondition (and) :effect (and))
  (:action rest :parameters () :precondition (and) :effect (and)))
"""
"""The same mass on ground that is icy at times; the file knows nothing of motion."""

FLEET = """(define (domain fleet)
  (:types robot)
  (:constants ada bob cid - robot)
  (:predicates (lit ?r - robot))
  (:functions (place ?r - robot) (battery ?r - robot) (warmth))
  (:action drive :parameters (?r - robot) :precondition (and) :effect (and))
  (:action light :parameters (?r - robot) :precondition (and) :effect (and (lit ?r)))
  (:action wait :parameters () :precondition (and) :effect (and)))
"""
"""Three robots that drive, in a room; the file knows their lamps alone."""

EDGE = """(define (domain edge)
  (:predicates (unsafe) (terminal) (wet))
  (:functions (x) (y) (reward))
  (:action left :parameters () :precondition (and (> (x) -4))
    :effect (and (decrease (x) 1) (decrease (reward) 0.1)))
  (:action right :parameters () :precondition (and)
    :effect (and (increase (x) 1) (increase (y) (/ 1 (x))) (decrease (reward) 0.1)))
  (:action jump :parameters () :precondition (and)
    :effect (and (assign (y) 0) (when (and (wet)) (unsafe)) (not (wet))))
  (:process drift :parameters () :precondition (and (> (y) 1))
    :effect (and (decrease (x) (* #t 0.5))))
  (:event pit :parameters () :precondition (and (<= (x) -3))
    :effect (and (unsafe) (terminal) (decrease (reward) 5)))
  (:event wall :parameters () :precondition (and (> (x) 4)) :effect (and (assign (x) 4))))
"""
"""Everything that can flag a step: an effect, a condition, an event; and what divides by zero."""

GRID = """
(define (domain grid)
  (:requirements :strips :typing :negative-preconditions :conditional-effects :numeric-fluents)
  (:predicates (wet) (unsafe) (terminal))
  (:functions (row) (column) (reward))
  (:action right :parameters () :precondition (and)
    :effect (and (increase (column) 1)))
  (:action stay :parameters () :precondition (and) :effect (and))
  (:event prize :parameters () :precondition (and (> (column) 3))
    :effect (and (increase (reward) 5)))
  (:event hole :parameters () :precondition (and (> (row) 2))
    :effect (and (decrease (reward) 9) (unsafe) (terminal))))
"""
"""State: wet, row, column."""

SHIPPED = sorted(path.stem for path in DOMAINS.glob("*.pddl") if not path.stem.endswith("-problem"))


@functools.cache
def shipped(name):
    """The model of a shipped file."""
    return load_domain(DOMAINS / f"{name}.pddl").model


@functools.cache
def generated(seed):
    """A random domain that has flags and is quickly compiled."""
    random = Random(seed)
    while True:
        model = generate(random, PLANNABLE).model
        ground = model.ground
        schemas = (*ground.actions, *ground.processes, *ground.events)
        effects = sum(len(schema.effects) for schema in schemas)
        flagged = any(e.target < 0 for schema in schemas for e in schema.effects)
        if ground.actions and ground.fluents and flagged and effects < 40:
            return model.replace(dt=random.choice((1.0, 0.25)))


@functools.cache
def edge():
    """The model of `EDGE`."""
    return from_text(EDGE).model.replace(dt=0.5)


def adaptation(text, mode="residual", *, dt=0.1, seed=0, **settings):
    """An adaptation of a domain given as text."""
    chosen: Any = {"mode": mode, **settings}
    model = from_text(text).model.replace(dt=dt)
    return ModelAdaptation(model, AdaptationSettings(**chosen), np.random.SeedSequence(seed))


def adapted(of):
    """The model of an adaptation that is switched on."""
    assert isinstance(of.model, AdaptedModel)
    return of.model


def plus(state, *change):
    """A state changed by so much."""
    return state + np.array(change)


def error(of, state, action, after):
    """`[F]` how far the model in use is off."""
    return np.abs(of.model.step(state, action).state - after)


def teach(of, world, rng, steps, *, draw=None, actions=None):
    """Show steps of a world from random states; return how far the model was off, `[steps, F]`.

    Without `draw`, fluents are normal and predicates true or false; without `actions`, all come.
    """
    model = of.model
    errors = np.empty((steps, len(model.fluents)))
    chosen = actions or tuple(range(len(model.actions)))
    for k in range(steps):
        state = any_state(model, rng) if draw is None else draw(rng)
        action = int(rng.choice(chosen))
        after = world(state, action)
        errors[k] = error(of, state, action, after)
        of.observe(state, action, after, False)
    return errors


def any_state(model, rng):
    """A state of normal numbers, and predicates that are true or false."""
    state = rng.normal(size=len(model.fluents))
    for fluent in model.fluents:
        if not fluent.numeric:
            state[fluent.index] = float(rng.integers(2))
    return state


# Arbitrary adaptations -------------------------------------------------------------------------

MILD = (1.0, -1.0, 0.3, -0.01, 2.0, 0.0)
WILD = (*MILD, 1e6, -1e30, 1e200, -1e308, np.inf, -np.inf, np.nan, 5e-324)


def publish(model, rng, numbers):
    """Put arbitrary weights wherever an adaptation could put some: normal, or of these numbers."""
    if rng.random() < 0.5:
        drawn = _weights(model.theta.shape, rng, numbers)
        model.core.adopt(np.where(np.isfinite(drawn), drawn, model.theta))
    for regression in model.regressions.values():
        _publish(regression, rng, numbers)
    if model.worth is not None and rng.random() < 0.5:
        _publish(model.worth, rng, numbers)
        model.worth.shrink[:] *= 0.05  # or hardly any state is within the range of the data
        model.worth.typical[:] = rng.integers(2, size=model.worth.typical.shape)


def count(model, rng):
    """Put arbitrary counts of outcomes wherever some could be: of one in all, or by context."""
    groups = {group.key: group for groups in model.feature_groups for group in groups}
    for key, group in groups.items():
        where = {column: place for place, column in enumerate(group.inputs)}
        places = np.array(sorted(where[c] for c in {*group.predicates, *group.targets}), np.int64)
        if not len(places) or rng.random() < 0.3:
            continue
        table = OutcomeTable(places, np.zeros(0, np.int64))
        kinds = int(rng.integers(2, 5))
        numeric = [model.fluents[group.inputs[place]].numeric for place in places]
        schemas = len({action.schema for action in model.actions})
        table.schemas[:kinds] = -1, *rng.integers(-1, schemas, kinds - 1)
        changes = rng.integers(-2, 3, (kinds - 1, len(places)))
        table.changes[1:kinds] = np.where(numeric, changes, 0.0)
        counts = rng.choice((1.0, 3.0, 50.0), kinds)
        table.counts[0, :kinds] = counts
        table.totals[0] = table.numbers[0] = counts.sum()
        table.members[0] = 1
        table.restore(kinds, 1, 1)
        model.shared[key].outcomes = table


def _publish(part, rng, numbers):
    part.features = FEATURES if rng.random() < 0.5 else 0
    kinds = (FILE, LINEAR, CURVED, FULL) if part.features else (FILE, LINEAR)
    part.kinds = rng.choice(kinds, size=part.kinds.shape)
    for weights in (
        part.linear, part.amplitude, part.centre, part.shrink, part.frequency, part.phase
    ):  # fmt: skip
        weights[:] = _weights(weights.shape, rng, numbers)


def _weights(shape, rng, numbers):
    drawn = rng.choice(np.array(numbers), size=shape)
    return np.where(rng.random(shape) < 0.5, rng.normal(size=shape), drawn)
