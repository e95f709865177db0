"""Settings as a whole: presets, changes over them, and what is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.errors import SettingsError
from serp.settings import PRESETS, Settings, resolve
from tests.generated.profile import examples

SECTIONS = st.fixed_dictionaries(
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
        "training": st.fixed_dictionaries(
            {}, optional={"checkpoint_seconds": st.floats(0) | st.just(float("inf"))}
        ),
    },
)


@examples(60)
@given(st.sampled_from(sorted(PRESETS)), SECTIONS)
def test_any_settings_are_read_back_equal(preset: str, changes: dict[str, dict[str, Any]]) -> None:
    settings = resolve(preset, None, changes)
    text = json.dumps(settings.as_dict(), allow_nan=False)
    assert Settings.from_dict(json.loads(text)) == settings
    assert settings.replace({}) == settings == settings.replace({"planner": {}})


def test_changes_go_over_the_task_and_the_task_over_the_preset() -> None:
    task = {"*": {"planner": {"depth": 7, "repeat": 2}}, "paper": {"planner": {"depth": 8}}}
    paper = resolve("paper", task, {"planner": {"repeat": 3}})
    assert (paper.planner.depth, paper.planner.repeat) == (8, 3)
    assert paper.planner.discount == PRESETS["paper"]["planner"]["discount"]
    default = resolve("default", task)
    assert (default.planner.depth, default.planner.repeat) == (7, 2)


def test_the_paper_preset_is_algorithm_1_and_section_4() -> None:
    paper = resolve("paper")
    assert (paper.arbiter.rho, paper.arbiter.rho_increment) == (0.0, 0.01)
    assert (paper.arbiter.rho_unit, paper.arbiter.veto_horizon) == ("episode", "step")
    assert paper.arbiter.exploration_slack is None
    assert paper.arbiter.indifferent == "first"
    assert paper.planner.leaf_value == "never"
    assert (paper.learner.learning_rate, paper.learner.discount) == (0.001, 0.9)
    assert paper.learner.epsilon_start == paper.learner.epsilon_end == 0.3
    assert (paper.learner.loss, paper.learner.n_step) == ("mse", 1)
    assert not paper.learner.has_target
    assert not paper.learner.double
    assert paper.training.random_steps > 0  # D_0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (3, "settings must be a mapping such as .*, not 3"),
        ({"arbiter": 3}, "section `arbiter` must be a mapping such as .*, not 3"),
        ({"planner": None}, "section `planner` must be a mapping such as .*, not None"),
        ({3: {}}, "no section `3`"),
        ({"planner": {3: 4}}, "no setting `planner.3`"),
        ({"planer": {}}, "no section `planer`; did you mean `planner`"),
        ({"planner": {"dept": 3}}, "no setting `planner.dept`; did you mean `depth`"),
        ({"planner": {"depth": 0}}, "planner.depth must be greater than or equal to 1, not 0"),
        ({"training": {"reward": "x"}}, "must be 'task', 'domain', 'environment' or 'sum'"),
        ({"correction": {"mode": "full"}}, "section `correction` is now called `adaptation`"),
        ({"adaptation": {"tries": 4}}, "now called `adaptation.min_visits`"),
        ({"adaptation": {"mode": "literals"}}, "`literals` is now called `parameters`"),
        ({"arbiter": {"surety": 1.0}}, "now called `arbiter.confidence_margin`"),
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


def test_a_section_is_what_it_is_called() -> None:
    with pytest.raises(SettingsError, match="section `planner` must be a PlannerSettings, not 3"):
        Settings(planner=3)


@pytest.mark.parametrize("of_task", [3, ["*"], {"*": 3}, {"*": {"planner": 3}}])
def test_settings_of_a_task_that_are_none_are_refused(of_task: Any) -> None:
    with pytest.raises(SettingsError, match="must be a mapping such as"):
        resolve("default", of_task)


@pytest.mark.parametrize("preset", [3, None, ["paper"], "papr"])
def test_a_preset_that_does_not_exist_is_refused(preset: Any) -> None:
    with pytest.raises(SettingsError, match="there is no preset"):
        resolve(preset)
