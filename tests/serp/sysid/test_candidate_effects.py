"""Terms that could be missing."""

from __future__ import annotations

import numpy as np
import pytest

from serp.sysid.candidate_effects import candidate_effects, may_change
from serp.sysid.lifted_features import WORLD, LiftedFluent, LiftedModel
from serp.sysid.parameter_fit import ParameterEstimator
from serp.sysid.regression_data import regression_data
from tests.serp.sysid.rolls import from_text, imagined
from tests.serp.sysid.test_parameter_fit import CARTS, carts_states

SPEED = LiftedFluent("v", ("?c",))


@pytest.mark.parametrize(
    ("effect", "target", "may"),
    [
        ("(assign (v ?c) 0.125)", SPEED, True),
        ("(assign (v ?c) 0.125)", LiftedFluent("v", ("a",)), False),  # the same where ?c is a
        ("(assign (v ?c) 0.125)", LiftedFluent("x", ("?c",)), True),
        ("(when (and (loaded ?c)) (assign (v ?c) 0.125))", SPEED, False),
        ("(scale-up (v ?c) 0.125)", SPEED, False),
        ("(decrease (v ?c) 0.125)", SPEED, True),
    ],
)
def test_nothing_is_added_to_what_it_contradicts(
    effect: str, target: LiftedFluent, may: bool
) -> None:
    text = CARTS.replace("(assign (v ?c) 0.125)", effect)
    lifted = LiftedModel(from_text(text).model.ground)
    assert may_change(lifted, lifted.schema("stop"), target) is may


def test_columns_are_the_changes_that_the_terms_would_make() -> None:
    model = from_text(CARTS).model.replace(dt=0.1)
    rng = np.random.default_rng(0)
    seen = imagined(model, carts_states(80, rng), rng, 0.1)
    sample = regression_data(model, seen.states, seen.actions, seen.next_states)
    rows = ParameterEstimator(model).estimate(sample, model.theta).rows["v"]
    lifted = LiftedModel(model.ground)
    after = sample.states + 1.0  # what the actions have done to it
    terms, columns = candidate_effects(lifted, sample, after, rows, "v", 0.1, [])
    assert columns.shape == (len(rows.rows), len(terms)) and len(set(terms)) == len(terms)
    index = {f.name: f.index for f in model.fluents}
    for term, column in zip(terms, columns.T, strict=True):
        for k, (row, fluent) in enumerate(zip(rows.rows, rows.fluents, strict=True)):
            action = model.actions[sample.actions[row]]
            if term.schema == WORLD:
                state, unit, bound = after[row], 0.1, model.fluents[fluent].arguments[0]
            else:
                state, unit, bound = sample.states[row], 1.0, action.arguments[0]
                named = term.target.name.replace("?c", bound)
                if action.schema != term.schema or named != model.fluents[fluent].name:
                    assert column[k] == 0.0
                    continue
            factors = [state[index[f.name.replace("?c", bound)]] for f in term.factors]
            assert column[k] == pytest.approx(unit * np.prod(factors))
    fewer, _ = candidate_effects(lifted, sample, after, rows, "v", 0.1, terms[:5])
    assert fewer == terms[5:]
