"""Settings of the strategies: what is refused, and what each name makes."""

from __future__ import annotations

import pytest

from serp.control.strategies.argmax_q import ArgmaxQ
from serp.control.strategies.dqfd import Demonstrations
from serp.control.strategies.imitate import ImitateThenLearn
from serp.control.strategies.jump_start import JumpStart
from serp.control.strategies.making import STRATEGIES, make_strategy
from serp.control.strategies.mixture import Mixture
from serp.control.strategies.residual import Residual
from serp.control.strategies.restrict import Restrict
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


def test_a_strategy_that_does_not_exist_is_refused_with_the_nearest() -> None:
    settings = Settings().replace({"guide": {"strategy": "jump-strat"}})
    with pytest.raises(SettingsError, match="no strategy `jump-strat`; did you mean `jump-start`"):
        make_strategy(settings, 0)


@pytest.mark.parametrize("name", STRATEGIES)
def test_every_name_makes_its_strategy(name: str) -> None:
    settings = resolve("default", None, {"guide": {"strategy": name}})
    assert type(make_strategy(settings, 0)) is CLASSES[name]


def test_every_strategy_is_there() -> None:
    assert set(CLASSES) == set(STRATEGIES)
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
