from __future__ import annotations

import pytest

from serp.model.learned.residual_features import FeatureGroup, feature_groups_of
from serp.model.transition_model import TransitionModel
from tests.serp.model.learned import worlds
from tests.serp.model.learned.rolls import from_text
from tests.serp.model.learned.worlds import FLEET

MODELS = [*worlds.SHIPPED, "fleet", "1", "4", "6"]


def model_of(name: str) -> TransitionModel:
    if name == "fleet":
        return from_text(FLEET).model
    return worlds.generated(int(name)) if name.isdigit() else worlds.shipped(name)


def groups_of(model: TransitionModel, action: str) -> tuple[FeatureGroup, ...]:
    return feature_groups_of(model.ground, model.actions[model.action_index(action)])


@pytest.mark.parametrize("name", MODELS)
def test_every_number_is_predicted_once_and_a_key_says_what_it_is_predicted_from(name: str) -> None:
    model = model_of(name)
    numeric = [fluent.index for fluent in model.fluents if fluent.numeric]
    shapes: dict[object, object] = {}
    for action in model.actions:
        of_action = feature_groups_of(model.ground, action)
        assert sorted(column for group in of_action for column in group.targets) == numeric
        for group in of_action:
            assert len(set(group.inputs)) == len(group.inputs)
            assert set(group.targets) | set(group.predicates) <= set(group.inputs)
            assert not any(
                model.fluents[group.inputs[place]].numeric for place in group.predicate_inputs
            )
            # What shares a key has the same symbols in the same places.
            symbols = [
                [model.fluents[column].symbol for column in columns]
                for columns in (group.inputs, group.targets, group.predicates)
            ]
            shape = (action.schema, symbols, group.predicate_inputs)
            assert shapes.setdefault(group.key, shape) == shape
