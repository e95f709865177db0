"""Algorithms by name: those of serp, those with other settings, and external ones."""

from __future__ import annotations

import pickle

import pytest

from serp.errors import SettingsError
from serp.runs.comparison import algorithms
from serp.runs.comparison.algorithms import OWN, find_algorithm
from serp.settings import resolve
from tests.serp.runs.comparison import contest


def test_the_algorithms_of_serp_have_settings_that_exist() -> None:
    for name, algorithm in OWN.items():
        assert find_algorithm(name) is algorithm
        resolve(algorithm.preset, None, algorithm.changes)
    assert {"ppo", "sb3-dqn"} <= set(algorithms.algorithm_entries())


def test_settings_are_changed_by_the_name() -> None:
    found = find_algorithm("dqn:learner.hidden=[8,8];learner.epsilon_start=0.5; arbiter.r_min=none")
    assert found.changes == OWN["dqn"].changes | {
        "learner": {"epsilon_start": 0.5, "hidden": (8, 8)}, "arbiter": {"r_min": None}
    }  # fmt: skip
    for name in ("serp:", "serp:members=1", "serp:learner.members"):
        with pytest.raises(SettingsError, match=r"expected section.name=value"):
            find_algorithm(name)


def test_an_external_algorithm_is_described_by_the_first_line_of_its_docstring(
    external: None,
) -> None:
    algorithm = find_algorithm("drawing")
    assert (algorithm.kind, algorithm.description) == ("external", "Draws its actions")
    assert algorithm.make_external is contest.Drawing
    assert pickle.loads(pickle.dumps(algorithm)) == algorithm  # other processes need it
    with pytest.raises(SettingsError, match="`drawing` has no settings that serp could change"):
        find_algorithm("drawing:learner.members=1")


def test_a_name_that_does_not_exist_or_cannot_be_loaded_is_refused(external: None) -> None:
    with pytest.raises(SettingsError, match="no algorithm `drawin`; did you mean `drawing`"):
        find_algorithm("drawin")
    with pytest.raises(SettingsError, match=r"`broken` \(tests.serp.nosuch:make\)"):
        find_algorithm("broken")
