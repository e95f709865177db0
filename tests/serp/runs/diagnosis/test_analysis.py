"""What transitions say about a domain file."""

import numpy as np
import pytest

from serp.runs.diagnosis.analysis import findings
from tests.serp.model.learned.rolls import from_text, imagined, on_ice
from tests.worlds import DOMAINS, text

FLEET = text("battery-fleet")
TRUE_FLEET = FLEET.replace(
    "(increase (way ?r) 0.5)",
    "(increase (way ?r) 0.5) (decrease (battery ?r) (+ 0.2 (* 0.3 (load ?r))))",
).replace(
    "    :effect (and)))",
    """    :effect (and))
  (:process blow
    :parameters (?r - robot)
    :precondition (and)
    :effect (and (increase (way ?r) (* #t (* 0.7 (wind)))))))""",
)
ROBOTS = """
(define (problem three) (:domain fleet) (:objects r1 r2 r3 - robot)
  (:init) (:goal (and)))
"""


def terms(found, schema, fluent):
    return {
        t.fluents: t.coefficient
        for m in found.missing
        if (m.schema, m.fluent) == (schema, fluent)
        for t in m.terms
    }


def test_objects_of_one_type_share_one_model():
    model = from_text(FLEET, ROBOTS).model.replace(dt=0.5)
    truth = from_text(TRUE_FLEET, ROBOTS).model.replace(dt=0.5)
    rng = np.random.default_rng(0)
    states = rng.uniform(-1.0, 1.0, size=(600, len(model.fluents)))
    seen = imagined(truth, states, rng, noise=0.001)
    found = findings(model, seen)
    assert found == findings(model, seen)
    assert terms(found, "drive", "battery ?r") == pytest.approx(
        {(): -0.2, ("load ?r",): -0.3}, abs=0.005
    )
    assert terms(found, "", "way ?r") == pytest.approx({("wind",): 0.7}, abs=0.01)
    assert len(found.missing) == 2


def test_noise_alone_is_no_finding():
    model = from_text(TRUE_FLEET, ROBOTS).model.replace(dt=0.5)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        states = rng.uniform(-1.0, 1.0, size=(400, len(model.fluents)))
        found = findings(model, imagined(model, states, rng, noise=0.05))
        assert not found.missing and not found.stochastic
        for literal in found.parameters:
            assert abs(literal.estimate - literal.written) < 4.5 * literal.error
    domain = from_text((DOMAINS / "cliff.pddl").read_text(encoding="utf-8"))
    cells = np.stack([rng.integers(0, 4, 500), rng.integers(0, 12, 500)], axis=1).astype(float)
    assert not findings(domain.model, imagined(domain.model, cells, rng)).stochastic


WALK = """(define (domain walk)
  (:requirements :numeric-fluents :conditional-effects)
  (:functions (gap) (room))
  (:action walk :parameters () :precondition (and) :effect (and {})))"""
NEARER = "(decrease (gap) 0.2)"


def walked(said, done, least=0.0):
    """Findings of a file that says what a walk does, where it does something else."""
    rng = np.random.default_rng(0)
    states = rng.uniform(least, least + 1.0, size=(600, 2))
    seen = imagined(from_text(WALK.format(done)).model, states, rng, noise=0.003)
    return findings(from_text(WALK.format(said)).model, seen)


def test_an_effect_that_is_there_is_not_explained_away():
    # A line through both cases would make the walk lead away, and the room do the walking.
    found = walked(NEARER, "(when (and (> (room) 0.5)) (decrease (gap) 0.1))")
    (literal,) = found.parameters
    assert literal.estimate == pytest.approx(0.05, abs=0.01)
    assert not found.missing


def test_a_line_through_a_few_large_changes_is_no_effect():
    assert not walked("", "(when (and (> (room) 0.8)) (decrease (gap) (room)))").missing
    found = walked("", "(decrease (gap) (room))")
    assert terms(found, "", "gap") == pytest.approx({("room",): -1.0}, abs=0.01)


def test_a_line_is_found_where_neither_constant_nor_slope_explains_anything_alone():
    found = walked("", "(increase (gap) (- (* 3 (room)) 16.5))", least=5.0)
    assert terms(found, "walk", "gap") == pytest.approx({(): -16.5, ("room",): 3.0}, rel=0.01)


# Chance ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("teleports", [False, True])
def test_how_often_the_ice_slips_is_told(teleports):
    """Of 2,000 random steps; falls that show the start mislead nobody."""
    domain = from_text((DOMAINS / "cliff.pddl").read_text(encoding="utf-8"))
    found = findings(domain.model, on_ice(domain, int(teleports), teleports=teleports))
    assert {o.schema for o in found.stochastic} == {"up", "right", "down", "left"}
    aside = {"up": "column", "down": "column", "left": "row", "right": "row"}
    for finding in found.stochastic:
        moves = [o for o in finding.outcomes if len(o.changes) == 1]
        assert teleports or len(moves) == len(finding.outcomes) == 3
        for outcome in moves:
            # 500 an action: a standard error is 0.02.
            assert outcome.probability == pytest.approx(1 / 3, abs=max(0.05, 4.0 * outcome.error))
            assert 0.01 < outcome.error < 0.04
            assert outcome.written == (outcome.changes[0][0] != aside[finding.schema])
    assert teleports or not (found.parameters or found.missing)
