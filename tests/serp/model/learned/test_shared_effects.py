"""Saying once what several actions have in common."""

from __future__ import annotations

from serp.model.learned.effect_fit import shared_effects
from serp.model.learned.parameter_fit import AddedEffect
from serp.model.learned.regression_data import WORLD, LiftedFluent, LiftedModel
from tests.serp.model.learned.rolls import DOMAINS, from_text
from tests.serp.runs.diagnosis.test_analysis import FLEET, ROBOTS

UPWARDS = LiftedFluent("upwards", ())


def landing() -> LiftedModel:
    text = (DOMAINS / "landing.pddl").read_text(encoding="utf-8")
    return LiftedModel(from_text(text).model.ground)


def test_what_is_about_equal_is_said_of_the_world_unless_it_is_already() -> None:
    fall, left, brake = (AddedEffect(s, UPWARDS, ()) for s in ("fall", "push-left", "brake"))
    world = AddedEffect(WORLD, UPWARDS, ())
    coefficients = {fall: -0.135, brake: 0.165, left: -0.136}
    assert list(shared_effects(landing(), coefficients)) == [([fall, left], world)]
    assert not list(shared_effects(landing(), {**coefficients, world: 1.0}))
    assert not list(shared_effects(landing(), {fall: -0.135, left: 0.135}))


def test_variables_become_those_of_the_function() -> None:
    text = FLEET.replace("?r - robot)\n    :pre", "?me - robot)\n    :pre")
    text = text.replace("(way ?r) 0.5", "(way ?me) 0.5")
    lifted = LiftedModel(from_text(text, ROBOTS).model.ground)
    own = [
        AddedEffect(s, LiftedFluent("battery", ("?me",)), (LiftedFluent("load", ("?me",)),))
        for s in ("drive", "rest")
    ]
    ((_, general),) = shared_effects(lifted, dict.fromkeys(own, 0.5))
    assert general == AddedEffect(
        WORLD, LiftedFluent("battery", ("?r",)), (LiftedFluent("load", ("?r",)),)
    )
    # Another object than the one that changes is none of the world's business.
    docked = [AddedEffect(a.schema, LiftedFluent("battery", ("dock",)), a.factors) for a in own]
    assert not list(shared_effects(lifted, dict.fromkeys(docked, 0.5)))
