"""Settings: what is accepted, how presets and changes combine, and what is refused by name."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.errors import SettingsError
from serp.settings import PRESETS, Settings, TrainingSettings, resolve
from tests.generated.profile import examples

OUTSIDE = {
    "planner.name": [3],
    "planner.depth": [0, 2.0, True, "5", 10_001, 10**30],
    "planner.discount": [0.0, 1.5, -0.1, math.nan, "high", False],
    "arbiter.rho": [-0.1, 1.1, "high", None, True, math.nan],
    "arbiter.r_min": ["low", math.nan, math.inf, True],
    "learner.hidden": [(0,), (64, 1.5), 64, "64", (True,), [2**70], np.ones((2, 2))],
    "learner.layer_norm": [1, "yes"],
    "training.reward": ["pixels", ["sum"], np.array(["sum", "task"])],
}
CHANGES = st.fixed_dictionaries(
    {},
    optional={
        "planner": st.fixed_dictionaries(
            {}, optional={"depth": st.integers(1, 9), "discount": st.floats(0.01, 0.99)}
        ),
        "arbiter": st.fixed_dictionaries({}, optional={"r_min": st.none() | st.floats(-5, 5)}),
        "learner": st.fixed_dictionaries(
            {}, optional={"hidden": st.lists(st.integers(1, 99), max_size=3)}
        ),
    },
)


@pytest.mark.parametrize("name", OUTSIDE)
def test_a_value_outside_its_range_is_refused_by_name_and_value(name):
    section, setting = name.split(".")
    for value in OUTSIDE[name]:
        with pytest.raises(SettingsError) as refusal:
            Settings().replace({section: {setting: value}})
        message = str(refusal.value)
        assert message.startswith(f"{name} must be "), message
        assert message.endswith(f"not {value!r}") or isinstance(value, np.ndarray | list | tuple)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (3, "settings must be a mapping such as .*, not 3"),
        ({"arbiter": 3}, "section `arbiter` must be a mapping such as .*, not 3"),
        ({3: {}}, "no section `3`"),
        ({"planner": {3: 4}}, "no setting `planner.3`"),
        ({"planer": {}}, "no section `planer`; did you mean `planner`"),
        ({"planner": {"dept": 3}}, "no setting `planner.dept`; did you mean `depth`"),
        ({"planner": {"depth": 0}}, "planner.depth must be greater than or equal to 1, not 0"),
        ({"training": {"reward": "x"}}, "must be 'task', 'domain', 'environment' or 'sum'"),
    ],
)
def test_what_does_not_exist_or_fit_is_refused_by_name(changes, said):
    for of_task, of_user in (({}, changes), ({"*": changes}, {})):
        with pytest.raises(SettingsError, match=said):
            resolve("default", of_task, of_user)
    with pytest.raises(SettingsError, match=said):
        Settings().replace(changes)


def test_numpys_numbers_are_taken_over_as_pythons_and_nothing_changes_in_place():
    changes = {
        "planner": {"depth": np.int64(3), "discount": np.float64(0.5)},
        "arbiter": {"rho": np.float32(0.5), "r_min": np.int16(-1)},
        "learner": {"hidden": np.array([8, 8]), "members": np.uint8(2), "layer_norm": np.True_},
    }
    settings = Settings().replace(changes)
    assert settings.learner.hidden == (8, 8)
    for _, values in settings:
        for _, value in values:
            assert type(value) in (int, float, bool, str, tuple, type(None))
    with pytest.raises(ValueError, match="frozen"):
        TrainingSettings().env_steps = 3


@examples(60)
@given(st.sampled_from(sorted(PRESETS)), CHANGES)
def test_any_settings_are_read_back_equal(preset, changes):
    settings = resolve(preset, None, changes)
    text = json.dumps(settings.as_dict(), allow_nan=False)
    assert Settings().replace(json.loads(text)) == settings
    assert settings.replace({}) == settings == settings.replace({"planner": {}})


def test_changes_go_over_the_task_and_the_task_over_the_preset():
    task = {"*": {"planner": {"depth": 7, "max_nodes": 2}}, "paper": {"planner": {"depth": 8}}}
    paper = resolve("paper", task, {"planner": {"max_nodes": 3}})
    assert (paper.planner.depth, paper.planner.max_nodes) == (8, 3)
    assert paper.planner.discount == PRESETS["paper"]["planner"]["discount"]
    default = resolve("default", task)
    assert (default.planner.depth, default.planner.max_nodes) == (7, 2)


def test_the_paper_preset_is_algorithm_1_and_section_4():
    paper = resolve("paper")
    assert (paper.arbiter.rho, paper.arbiter.rho_increment) == (0.0, 0.01)
    assert paper.arbiter.veto_horizon == "step"
    assert (paper.learner.learning_rate, paper.planner.discount) == (0.001, 0.9)
    assert (paper.learner.epsilon_steps, paper.learner.epsilon_end) == (0, 0.3)
    assert (paper.learner.n_step, paper.learner.target_polyak) == (1, None)
    assert paper.training.random_steps > 0  # D_0
