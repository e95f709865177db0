"""What an algorithm is like, and which settings it reads."""

from __future__ import annotations

import json

import pytest

from serp.comparison.algorithms import OWN, Algorithm, find_algorithm
from serp.comparison.trials.characteristics import settings_in_use
from serp.control.registry import strategy_names
from serp.settings import GuideSettings, Settings, resolve
from tests.serp.comparison.contest import GUIDED


def settings_of(algorithm: Algorithm) -> Settings:
    return resolve(algorithm.preset, None, algorithm.changes)


@pytest.mark.parametrize("name", list(OWN))
def test_only_what_is_read_is_told(name: str) -> None:
    algorithm = find_algorithm(name)
    used = settings_in_use(algorithm, settings_of(algorithm))
    assert used is not None
    json.dumps(used, allow_nan=False)
    if algorithm.kind == "guided":
        assert set(used) == {
            "planner", "adaptation", "arbiter", "guide", "learner", "training",
        }  # fmt: skip
    assert ("arbiter" in used) == ("guide" in used) == (name in GUIDED)
    assert ("planner" in used) == ("adaptation" in used) == (algorithm.kind != "baseline")
    assert ("learner" in used) == (algorithm.kind != "planner")
    assert not {"env_steps", "checkpoint_seconds"} & set(used.get("training", {}))


def test_every_setting_of_the_guide_is_read_by_some_strategy() -> None:
    told = set()
    for strategy in strategy_names():
        names = {"mixture": "serp-paper", "evidence": "serp"}
        algorithm = find_algorithm(names.get(strategy, strategy))
        used = settings_in_use(algorithm, settings_of(algorithm))
        assert used is not None
        assert used["guide"]["strategy"] == strategy
        told |= set(used["guide"])
        assert ("rho" in used["arbiter"]) == (strategy == "mixture")
    assert told == set(GuideSettings.model_fields)


def test_of_an_external_one_nothing_is_known(external: None) -> None:
    assert settings_in_use(find_algorithm("drawing"), Settings()) is None
