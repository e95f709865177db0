"""The map between ground actions and environment actions."""

import numpy as np
import pytest

from serp.errors import TaskError
from serp.model.flags import APPLICABLE
from serp.planning.forecast import SAFE
from serp.planning.lookahead import Lookahead
from serp.tasks.action_map import ActionMap
from tests.serp.planning.worlds import load
from tests.worlds import text

MODEL = load(text("rooms"))
NAMES = [action.name for action in MODEL.actions]
AT_A = MODEL.state({"at a": True, "at b": False})
AT_B = MODEL.state({"at a": False, "at b": True})


def test_a_schema_stands_for_all_its_instances_and_names_may_be_written_as_in_pddl():
    mapping = {"move": np.int64(2), "rest": np.uint8(0), "(DRILL)": 1}
    actions = ActionMap(MODEL, 3, mapping)
    by_name = dict(zip(NAMES, actions.environment_action, strict=True))
    assert by_name["move a b"] == by_name["move b a"] == 2
    assert (by_name["rest"], by_name["drill"]) == (0, 1)
    assert actions.name(2) == "move"
    assert actions.name(0) == "rest"


@pytest.mark.parametrize(
    ("mapping", "said"),
    [
        ({"move": 0, "rest": 1}, "no environment action for `drill`"),
        ({"rest": 1}, r"and \d more"),
        ({"move": 0, "rest": 1, "drill": 3}, r"`drill` is mapped to 3.* 0 to 2"),
        ({"move": 0, "rest": 1, "drill": -1}, "mapped to -1"),
        ({"move": 0, "rest": 1, "drill": "2"}, "mapped to '2'"),
        ({"move": 0, "rest": 1, "dril": 2}, "no action `dril`; did you mean `drill`"),
        ({"move": 0, "rest": 1, "drill": 2, "move a c": 2}, "no action `move a c`"),
    ],
)
def test_a_map_that_does_not_fit_is_refused(mapping, said):
    with pytest.raises(TaskError, match=said):
        ActionMap(MODEL, 3, mapping)


def test_more_ground_actions_than_the_environment_has_need_a_map():
    with pytest.raises(TaskError, match=f"{len(NAMES)} ground actions, but the environment has 2"):
        ActionMap(MODEL, 2)


def test_the_applicable_one_of_several_counts():
    actions = ActionMap(MODEL, 3, {"move": 0, "rest": 1, "drill": 2})
    for state, name in ((AT_A, "move a b"), (AT_B, "move b a")):
        forecast = actions.project(Lookahead(MODEL).forecast(state))
        assert NAMES[forecast.ground[0]] == name
        assert forecast.flags[0] == APPLICABLE
        assert forecast.reward[0] == 1.0


def test_of_several_applicable_ones_the_worst_prediction_counts():
    ground = Lookahead(MODEL).forecast(AT_B)
    shared = ActionMap(MODEL, 2, {"move": 0, "rest": 1, "drill": 1}).project(ground)
    both = [k for k, name in enumerate(NAMES) if not name.startswith("move")]
    assert ground.applicable[both].all()
    assert shared.value[1] == ground.value[both].min()
    assert shared.reward[1] == ground.reward[both].min()
    assert shared.path_risk[1] == ground.path_risk[both].max()
    assert shared.safe_steps[1] == ground.safe_steps[both].min()


def test_what_the_model_does_not_know_has_neither_value_nor_flags():
    original = Lookahead(MODEL).forecast(AT_A)
    forecast = ActionMap(MODEL, len(NAMES) + 1).project(original)
    assert forecast.ground[-1] == -1
    assert forecast.value[-1] == -np.inf
    assert forecast.safe_steps[-1] == SAFE
    assert (forecast.reward[-1], forecast.flags[-1]) == (0.0, 0)
    assert (forecast.value[:-1] == original.value).all()
