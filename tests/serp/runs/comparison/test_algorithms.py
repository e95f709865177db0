"""Algorithms by name: those of serp, those with other settings, and external ones."""

from __future__ import annotations

import pickle
from importlib.metadata import EntryPoint
from typing import Any

import pytest

from serp.errors import MissingExtra, SerpError, SettingsError
from serp.runs.comparison import algorithms
from serp.runs.comparison.algorithms import GROUP, OWN, find_algorithm
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


@pytest.mark.parametrize(("name", "near"), [("srep", "serp"), ("drawin", "drawing")])
def test_a_name_that_does_not_exist_is_refused_with_a_near_one(
    name: str, near: str, external: None
) -> None:
    with pytest.raises(SettingsError, match=f"no algorithm `{name}`; did you mean `{near}`"):
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


def test_an_external_algorithm_that_cannot_be_loaded_is_named(
    external: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SettingsError, match=r"`broken` \(tests.serp.nosuch:make\)"):
        find_algorithm("broken")

    class Needy(EntryPoint):
        def load(self) -> Any:
            raise MissingExtra("a comparison with something", "something")

    needy = {"needy": Needy("needy", "x:y", GROUP)}
    monkeypatch.setattr(algorithms, "algorithm_entries", lambda: needy)
    with pytest.raises(SerpError, match=r"pip install 'serp\[something\]'"):
        find_algorithm("needy")
