"""Terms that could be missing."""

from __future__ import annotations

import pytest

from serp.model.learned.effect_search import may_change
from serp.model.learned.regression_data import LiftedFluent, LiftedModel
from tests.serp.model.learned.rolls import from_text
from tests.serp.model.learned.test_parameter_fit import CARTS

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
