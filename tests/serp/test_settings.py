"""Settings: presets, changes over them, and what is refused."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.errors import SettingsError
from serp.settings import PRESETS, Settings, TrainingSettings, _from_json, _to_json, resolve
from tests.generated.profile import examples


@pytest.mark.parametrize("preset", PRESETS)
def test_what_is_written_to_a_run_is_read_back_equal(preset: str) -> None:
    settings = resolve(preset).replace({"arbiter": {"exploration_slack": float("inf")}})
    text = json.dumps(settings.as_dict(), allow_nan=False)
    assert Settings.from_dict(json.loads(text)) == settings


@examples(60)
@given(
    st.fixed_dictionaries(
        {},
        optional={
            "planner": st.fixed_dictionaries(
                {}, optional={"depth": st.integers(1, 9), "discount": st.floats(0.01, 1.0)}
            ),
            "arbiter": st.fixed_dictionaries(
                {},
                optional={
                    "rho_increment": st.floats(0, 1),
                    "r_min": st.none() | st.floats(-5, 5),
                    "exploration_slack": st.none() | st.floats(0) | st.just(float("inf")),
                    "rho_unit": st.text(max_size=5),
                },
            ),
            "learner": st.fixed_dictionaries(
                {}, optional={"hidden": st.lists(st.integers(1, 99), max_size=3)}
            ),
        },
    )
)
def test_any_change_is_read_back_equal(changes: dict[str, dict[str, Any]]) -> None:
    settings = Settings().replace(changes)
    text = json.dumps(settings.as_dict(), allow_nan=False)
    assert Settings.from_dict(json.loads(text)) == settings


def test_changes_go_over_the_task_and_the_task_over_the_preset() -> None:
    task = {"*": {"planner": {"depth": 7, "repeat": 2}}, "paper": {"planner": {"depth": 8}}}
    paper = resolve("paper", task, {"planner": {"repeat": 3}})
    assert (paper.planner.depth, paper.planner.repeat) == (8, 3)
    assert paper.planner.discount == PRESETS["paper"]["planner"]["discount"]
    default = resolve("default", task)
    assert (default.planner.depth, default.planner.repeat) == (7, 2)


def test_the_paper_preset_is_algorithm_1_and_section_4() -> None:
    paper = resolve("paper")
    assert paper.arbiter.rho == 0.0
    assert paper.arbiter.rho_increment == 0.01
    assert paper.arbiter.rho_unit == "episode"
    assert paper.arbiter.veto_horizon == "step"
    assert paper.arbiter.exploration_slack is None
    assert paper.arbiter.indifferent == "first"
    assert paper.planner.leaf_value == "never"
    assert paper.learner.learning_rate == 0.001
    assert paper.learner.discount == 0.9
    assert paper.learner.epsilon_start == paper.learner.epsilon_end == 0.3
    assert paper.learner.loss == "mse"
    assert not paper.learner.has_target
    assert not paper.learner.double
    assert paper.learner.n_step == 1
    assert paper.training.random_steps > 0  # D_0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (3, "settings must be a mapping such as .*, not 3"),
        ({"arbiter": 3}, "section `arbiter` must be a mapping such as .*, not 3"),
        ({"planner": None}, "section `planner` must be a mapping such as .*depth.*, not None"),
        ({3: {}}, "no section `3`"),
        ({"planner": {3: 4}}, "no setting `planner.3`"),
        ({"training": {"env_steps": 1.5}}, "env_steps must be a whole number >= 1, not 1.5"),
        ({"training": {"env_steps": True}}, "env_steps"),
        ({"training": {"tensorboard": 1}}, "tensorboard must be true or false, not 1"),
        ({"training": {"checkpoint_seconds": "15"}}, "checkpoint_seconds must be >= 0, not '15'"),
        ({"training": {"inputs": ["both"]}}, "inputs"),
        ({"training": {"inputs": np.array(["both", "state"])}}, "inputs"),
        ({"correction": {"tries": 2**70}}, r"tries must be a whole number from 0 to 2\^53"),
        ({"arbiter": {"broken_promises": 10**400}}, r"broken_promises must be a whole number"),
        ({"learner": {"discount": "0.9"}}, "discount is '0.9', but must be"),
        ({"learner": {"loss": np.array(["mse", "huber"])}}, "loss"),
        ({"planer": {}}, "no section `planer`; did you mean `planner`"),
        ({"planner": {"dept": 3}}, "no setting `planner.dept`; did you mean `depth`"),
        ({"planner": {"depth": 0}}, "depth"),
        ({"planner": {"depth": "5"}}, "depth"),
        ({"planner": {"leaf_value": "sometimes"}}, "leaf_value must be never or .*'sometimes'"),
        ({"planner": {"leaf_value": 1}}, "leaf_value"),
        ({"planner": {"leaf_value": np.array(["never", "always"])}}, "leaf_value"),
        ({"arbiter": {"rho": "high"}}, "arbiter"),
        ({"arbiter": {"rho": None}}, "arbiter"),
        ({"learner": {"hidden": "64"}}, "hidden"),
        ({"training": {"random_steps": -1}}, "random_steps"),
        ({"training": {"random_steps": "many"}}, "training"),
        ({"training": {"env_steps": 0}}, "env_steps"),
        ({"training": {"inputs": "pixels"}}, "inputs"),
        ({"training": {"checkpoint_seconds": float("nan")}}, "checkpoint_seconds"),
        ({"training": {"checkpoint_seconds": -1.0}}, "checkpoint_seconds"),
        ({"training": {"slow_step_seconds": 0}}, "slow_step_seconds must be > 0, not 0"),
        ({"training": {"slow_step_seconds": "30"}}, "slow_step_seconds must be > 0, not '30'"),
    ],
)
def test_what_does_not_exist_or_fit_is_refused_by_name(changes: Any, said: str) -> None:
    applications: tuple[Callable[[], Settings], ...] = (
        lambda: Settings().replace(changes),
        lambda: resolve("default", None, changes),
        lambda: resolve("default", {"*": changes}),
        lambda: Settings.from_dict(changes),
    )
    for apply in applications:
        with pytest.raises(SettingsError, match=said):
            apply()


def test_numpys_numbers_are_taken_over_as_pythons() -> None:
    changes: dict[str, dict[str, Any]] = {
        "planner": {"depth": np.int64(3), "discount": np.float64(0.5)},
        "arbiter": {"rho": np.float32(0.5), "r_min": np.int16(-1)},
        "learner": {
            "hidden": np.array([8, 8]),
            "members": np.int64(2),
            "discount": np.float32(0.5),
            "double": np.True_,
            "target_period": None,
            "target_polyak": np.float64(0.5),
        },
        "training": {
            "env_steps": np.int32(9),
            "checkpoint_seconds": np.float64(2),
            "tensorboard": np.False_,
        },
    }
    settings = resolve("default", None, changes)
    for section in dataclasses.asdict(settings).values():
        for value in section.values():
            assert type(value) in (int, float, bool, str, tuple, type(None))
    assert [type(size) for size in settings.learner.hidden] == [int, int]
    text = json.dumps(settings.as_dict(), allow_nan=False)
    assert Settings.from_dict(json.loads(text)) == settings
    one = TrainingSettings(env_steps=np.int64(3), checkpoint_seconds=np.float32(1))  # type: ignore[arg-type]
    assert one == TrainingSettings(env_steps=3, checkpoint_seconds=1.0)


def test_a_training_may_save_at_its_end_alone() -> None:
    settings = Settings().replace({"training": {"checkpoint_seconds": float("inf")}})
    text = json.dumps(settings.as_dict(), allow_nan=False)
    assert Settings.from_dict(json.loads(text)) == settings


def test_both_infinities_have_a_word_in_json() -> None:
    for value, word in ((float("inf"), "inf"), (float("-inf"), "-inf")):
        assert _to_json(value) == word
        assert _from_json(word) == value


@pytest.mark.parametrize("section", ["planner", "arbiter", "learner", "training"])
def test_a_section_is_what_it_is_called(section: str) -> None:
    with pytest.raises(SettingsError, match=f"section `{section}` must be a .*Settings, not 3"):
        Settings(**{section: 3})


@pytest.mark.parametrize("of_task", [3, ["*"], {"*": 3}, {"*": {"planner": 3}}])
def test_settings_of_a_task_that_are_none_are_refused(of_task: Any) -> None:
    with pytest.raises(SettingsError, match="must be a mapping such as"):
        resolve("default", of_task)


@pytest.mark.parametrize("preset", [3, None, ["paper"]])
def test_a_preset_that_is_no_name_is_refused(preset: Any) -> None:
    with pytest.raises(SettingsError, match="there is no preset"):
        resolve(preset)


def test_a_preset_that_does_not_exist_is_refused() -> None:
    with pytest.raises(SettingsError, match="no preset `papr`; did you mean `paper`"):
        resolve("papr")


def test_replacing_nothing_changes_nothing() -> None:
    settings = resolve("paper")
    assert settings.replace({}) == settings
    assert settings.replace({"planner": {}}) == settings


def test_settings_cannot_be_changed_in_place() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        TrainingSettings().env_steps = 3  # type: ignore[misc]
