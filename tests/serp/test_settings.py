"""Settings: presets, changes over them, and what is refused."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.errors import SettingsError
from serp.settings import PRESETS, Settings, TrainingSettings, resolve
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
        ({"planer": {}}, "no section `planer`; did you mean `planner`"),
        ({"planner": {"dept": 3}}, "no setting `planner.dept`; did you mean `depth`"),
        ({"planner": {"depth": 0}}, "depth"),
        ({"planner": {"depth": "5"}}, "depth"),
        ({"arbiter": {"rho": "high"}}, "arbiter"),
        ({"arbiter": {"rho": None}}, "arbiter"),
        ({"learner": {"hidden": "64"}}, "hidden"),
        ({"training": {"random_steps": -1}}, "random_steps"),
        ({"training": {"random_steps": "many"}}, "training"),
        ({"training": {"env_steps": 0}}, "env_steps"),
        ({"training": {"inputs": "pixels"}}, "inputs"),
        ({"training": {"checkpoint_seconds": float("nan")}}, "checkpoint_seconds"),
        ({"training": {"checkpoint_seconds": -1.0}}, "checkpoint_seconds"),
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
