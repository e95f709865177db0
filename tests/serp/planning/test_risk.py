"""A plan takes as little risk as it can, and what the file flags last of all."""

from __future__ import annotations

import functools
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.adaptation.adapted_model import AdaptedModel
from serp.model.flags import RISKY, UNSAFE, joined, risk_of, with_risk
from serp.planning.lookahead import Lookahead
from serp.settings import PlannerSettings
from tests.generated.profile import examples
from tests.serp.adaptation import worlds
from tests.serp.planning.reference import Reference, as_state
from tests.serp.planning.test_lookahead import (
    PLANNERS,
    assert_all_forms_agree,
    bits,
    with_leaves,
    worth,
)
from tests.serp.planning.worlds import WORLDS, states_of, world

SETTINGS = st.builds(
    lambda settings, accepted: settings.replace(accepted_risk=accepted),
    PLANNERS,
    st.sampled_from((0.0, 0.02, 0.3)),
)


@functools.cache
def risky_world(seed: int) -> AdaptedModel:
    """A world whose model has counted outcomes, and in half of the cases residuals as well."""
    model, rng = AdaptedModel(world(seed)), np.random.default_rng(seed)
    if seed % 2:
        worlds.publish(model, rng, worlds.MILD)
    worlds.count(model, rng)
    return model


@examples(100)
@given(st.integers(0, WORLDS - 1), SETTINGS, st.integers(0, 10**6))
def test_all_forms_find_the_plan_of_plain_recursion_where_models_see_risks(
    seed: int, settings: PlannerSettings, states_seed: int
) -> None:
    model, settings = risky_world(seed), settings.replace(depth=min(settings.depth, 3))
    states = states_of(model, Random(states_seed), 2)
    reference = Reference(model, settings)
    for state, forecast in zip(
        states, assert_all_forms_agree(model, settings, states), strict=True
    ):
        root = as_state(state)
        layers, _ = reference.layers(root)
        best = reference.best(root, layers)
        assert forecast.choice == (best.arcs[0].action if best.arcs else -1)
        for action in np.flatnonzero(forecast.applicable).tolist():
            arc = reference.arc(root, action)
            assert arc is not None
            path = reference.along(arc, layers - 1)
            assert forecast.path_risk[action] == path.danger
            assert forecast.safe_steps[action] == path.steps
            assert forecast.value[action] == path.value
            first = int(forecast.flags[action])
            assert arc.rank == (2 if first & UNSAFE else 1 if first & RISKY else 0)


@examples(60)
@given(st.integers(0, WORLDS - 1), SETTINGS, st.integers(0, 10**6))
def test_leaves_decide_among_equal_risks_only(
    seed: int, settings: PlannerSettings, other: int
) -> None:
    model = risky_world(seed)
    leaves = worth(model, other).packed
    plain = Lookahead(model, settings)
    always = with_leaves(model, settings, "always", leaves)
    asked = with_leaves(model, settings, "indifferent", leaves)
    for state in states_of(model, Random(other), 6):
        before = plain.forecast(state)
        expected = always.forecast(state) if before.indifferent else before
        assert bits(asked.forecast(state)) == bits(expected)


def test_these_worlds_hold_risks_of_every_size() -> None:
    met = {"flagged": 0, "none": 0, "accepted": 0, "some": 0, "certain": 0}
    for seed in range(WORLDS):
        model = risky_world(seed)
        for state in states_of(model, Random(seed), 10):
            for action in range(len(model.actions)):
                flags = model.transition(state.tolist(), action)[1]
                written = model.written.transition(state.tolist(), action)[1]
                assert flags & UNSAFE == written & UNSAFE
                risk = risk_of(flags)
                met[
                    "flagged" if flags & UNSAFE
                    else "none" if risk == 0.0
                    else "accepted" if risk <= 0.3
                    else "certain" if risk == 1.0
                    else "some"
                ] += 1  # fmt: skip
    assert min(met.values()) >= 15, met


@examples(100)
@given(st.integers(0, 31), st.integers(0, 31), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_flags_carry_a_risk_beside_their_bits(
    bits: int, others: int, risk: float, other: float
) -> None:
    flags, further = with_risk(bits, risk), with_risk(others, other)
    assert flags & 0xFF == bits
    both = joined(flags, further)
    assert both & 0xFF == bits | others
    if not bits & UNSAFE:
        assert risk_of(flags) == pytest.approx(risk, abs=2.0**-25)
    if not (bits | others) & UNSAFE:
        assert risk_of(both) == pytest.approx(1 - (1 - risk) * (1 - other), abs=2.0**-22)
    else:
        assert risk_of(both) == 1.0
