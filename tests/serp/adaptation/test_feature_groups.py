from __future__ import annotations

import pytest

from serp.adaptation.feature_groups import MOST_BITS, FeatureGroup, feature_groups_of
from serp.model.transition_model import TransitionModel
from tests.serp.sysid import worlds
from tests.serp.sysid.rolls import from_text
from tests.serp.sysid.worlds import FLEET

MODELS = [*worlds.SHIPPED, "fleet", "1", "4", "6"]


def model_of(name: str) -> TransitionModel:
    if name == "fleet":
        return from_text(FLEET).model
    return worlds.generated(int(name)) if name.isdigit() else worlds.shipped(name)


def views(model: TransitionModel, action: str) -> tuple[FeatureGroup, ...]:
    return feature_groups_of(model.ground, model.actions[model.action_index(action)])


@pytest.mark.parametrize("name", MODELS)
def test_every_number_is_predicted_once_and_seen_where_it_is(name: str) -> None:
    model = model_of(name)
    numeric = [fluent.index for fluent in model.fluents if fluent.numeric]
    for action in model.actions:
        of_action = feature_groups_of(model.ground, action)
        assert sorted(column for view in of_action for column in view.targets) == numeric
        for view in of_action:
            assert len(set(view.inputs)) == len(view.inputs)
            assert set(view.targets) <= set(view.inputs)
            assert set(view.predicates) <= set(view.inputs)
            assert len(view.bits) <= MOST_BITS
            for place in view.bits:
                assert not model.fluents[view.inputs[place]].numeric


@pytest.mark.parametrize("name", MODELS)
def test_what_shares_a_key_has_the_same_symbols_in_the_same_places(name: str) -> None:
    model = model_of(name)
    shapes: dict[object, object] = {}
    for action in model.actions:
        for view in feature_groups_of(model.ground, action):
            symbols = [
                [model.fluents[column].symbol for column in columns]
                for columns in (view.inputs, view.targets, view.predicates)
            ]
            shape = (action.schema, symbols, view.bits)
            assert shapes.setdefault(view.key, shape) == shape


def test_actions_on_objects_of_one_type_share_their_models() -> None:
    model = from_text(FLEET).model
    keys = [{view.key for view in views(model, f"drive {name}")} for name in ("ada", "bob", "cid")]
    assert keys[0] == keys[1] == keys[2]
    assert len(keys[0]) < len(views(model, "drive ada")) + 1


def test_what_an_action_does_to_its_own_object_is_no_model_of_what_it_does_to_others() -> None:
    model = from_text(FLEET).model
    column = {fluent.name: fluent.index for fluent in model.fluents}
    of_action = {target: view.key for view in views(model, "drive ada") for target in view.targets}
    own, bob, cid = (of_action[column[f"place {name}"]] for name in ("ada", "bob", "cid"))
    assert own != bob == cid


def test_different_schemas_share_nothing() -> None:
    model = from_text(FLEET).model
    driving, lighting, waiting = (
        {view.key for view in views(model, action)} for action in ("drive ada", "light ada", "wait")
    )
    assert not driving & lighting and not driving & waiting and not lighting & waiting


def test_so_many_predicates_make_no_modes() -> None:
    def bits(count: int) -> int:
        predicates = " ".join(f"(p{k})" for k in range(count))
        flips = " ".join(f"(p{k})" for k in range(count))
        model = from_text(
            f"(define (domain d) (:predicates {predicates}) (:functions (x))"
            f" (:action go :parameters () :precondition (and)"
            f" :effect (and (increase (x) 1) {flips})))"
        ).model
        return max(len(view.bits) for view in views(model, "go"))

    assert bits(MOST_BITS) == MOST_BITS
    assert bits(MOST_BITS + 1) == 0
