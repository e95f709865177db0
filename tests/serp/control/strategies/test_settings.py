"""Settings of the strategies: what is refused, and what each name makes."""

from __future__ import annotations

import math
from typing import get_args

import numpy as np
import pytest

from serp.control.strategies.argmax_q import ArgmaxQ
from serp.control.strategies.dqfd import Demonstrations
from serp.control.strategies.imitate import ImitateThenLearn
from serp.control.strategies.jump_start import JumpStart
from serp.control.strategies.making import make_strategy
from serp.control.strategies.mixture import Mixture
from serp.control.strategies.residual import Residual
from serp.control.strategies.restrict import Restrict
from serp.control.strategies.settings import STRATEGIES, GuideSettings, StrategyName
from serp.errors import SettingsError
from serp.settings import Settings, resolve

CLASSES = {
    "mixture": Mixture,
    "jump-start": JumpStart,
    "argmax-q": ArgmaxQ,
    "restrict": Restrict,
    "imitate-then-learn": ImitateThenLearn,
    "residual": Residual,
    "dqfd": Demonstrations,
}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("jump_stages", 0),
        ("jump_stages", 1.5),
        ("jump_stages", True),
        ("jump_stages", "ten"),
        ("imitation_steps", 0),
        ("imitation_steps", -1),
        ("jump_tolerance", -0.1),
        ("jump_tolerance", math.nan),
        ("restrict_slack", -1),
        ("restrict_slack", math.inf),
        ("restrict_slack", None),
        ("margin", -0.8),
        ("margin", "wide"),
    ],
)
def test_a_value_outside_its_range_is_refused_by_name(name: str, value: object) -> None:
    with pytest.raises(SettingsError, match=f"guide: {name} must be"):
        GuideSettings(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", ["jumpstart", "", None, 3, ["residual"]])
def test_a_strategy_that_does_not_exist_is_refused(wrong: object) -> None:
    with pytest.raises(SettingsError, match="guide: there is no strategy"):
        GuideSettings(strategy=wrong)  # type: ignore[arg-type]


def test_a_near_miss_is_named() -> None:
    with pytest.raises(SettingsError, match="did you mean `jump-start`"):
        GuideSettings(strategy="jump-strat")  # type: ignore[arg-type]


def test_numpys_numbers_are_taken_over_as_pythons() -> None:
    made = GuideSettings(jump_stages=np.int64(3), margin=np.float32(0.5))  # type: ignore[arg-type]
    assert (made.jump_stages, made.margin) == (3, 0.5)
    assert type(made.jump_stages) is int
    assert type(made.margin) is float


def test_the_section_survives_json() -> None:
    settings = resolve("default", None, {"guide": {"strategy": "dqfd", "imitation_steps": 5}})
    assert Settings.from_dict(settings.as_dict()) == settings


@pytest.mark.parametrize("name", STRATEGIES)
def test_every_name_makes_its_strategy(name: StrategyName) -> None:
    settings = resolve("default", None, {"guide": {"strategy": name}})
    assert type(make_strategy(settings, 0)) is CLASSES[name]


def test_every_strategy_is_there() -> None:
    assert set(CLASSES) == set(STRATEGIES) == set(get_args(StrategyName))
    assert Settings().guide.strategy == "mixture"


def test_the_settings_reach_the_strategy() -> None:
    settings = resolve("default", None, {
        "guide": {"strategy": "dqfd", "imitation_steps": 2, "margin": 0.3},
    })  # fmt: skip
    strategy = make_strategy(settings, 0)
    assert strategy.guided is not None
    assert strategy.guided.margin == 0.3
    assert strategy.rho == 0.0
    strategy.end_unit("step")
    strategy.end_unit("step")
    assert strategy.rho == 1.0
