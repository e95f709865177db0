"""Conditions that exclude each other hold together in no state."""

from __future__ import annotations

from hypothesis import given

from serp.lint.exclusion import contradiction
from serp.model.flags import APPLICABLE
from serp.model.transition_model import Vector
from tests.generated.models import Generated, models_with_states
from tests.generated.profile import examples


@given(models_with_states(count=4))
@examples(150)
def test_an_action_whose_conditions_exclude_each_other_is_applicable_nowhere(
    drawn: tuple[Generated, Vector],
) -> None:
    generated, states = drawn
    model = generated.model
    theta = model.theta.tolist()
    for index, action in enumerate(model.actions):
        if contradiction(action.preconditions, theta):
            for state in states.tolist():
                assert not model.transition(state, index)[1] & APPLICABLE
