"""What an algorithm is like, and which settings it reads."""

from __future__ import annotations

import json

import pytest

from serp.runs.comparison.algorithms import OWN, Algorithm, find_algorithm, settings_in_use
from serp.settings import Settings, resolve
from tests.serp.runs.comparison.contest import GUIDED


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


def test_what_only_another_strategy_reads_is_left_out() -> None:
    for name in ("serp", "serp-paper"):
        algorithm = find_algorithm(name)
        used = settings_in_use(algorithm, settings_of(algorithm))
        assert used is not None
        assert ("rho" in used["arbiter"]) == (used["guide"]["strategy"] == "mixture")


def test_of_an_external_one_nothing_is_known(external: None) -> None:
    assert settings_in_use(find_algorithm("drawing"), Settings()) is None
