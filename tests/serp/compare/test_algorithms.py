"""Algorithms by name: ours, those with other settings, and those from outside."""

from __future__ import annotations

import pickle
from importlib.metadata import EntryPoint
from typing import Any

import pytest

from serp.compare import algorithms
from serp.compare.algorithms import GROUP, OWN, ablation, find_algorithm, merged
from serp.control.registry import strategy_names
from serp.errors import MissingExtra, SerpError, SettingsError
from serp.settings import resolve
from tests.serp.compare import contest


def test_all_of_ours_are_there_with_settings_that_exist() -> None:
    assert set(OWN) == set(contest.OWN)
    for name, algorithm in OWN.items():
        assert find_algorithm(name) is algorithm
        assert algorithm.name == name
        assert algorithm.description
        resolve(algorithm.preset, None, algorithm.changes)
        assert algorithm.uses_model == (name not in ("dqn", "dqn-paper"))


def test_every_strategy_is_an_algorithm_that_guides_by_it() -> None:
    for strategy in strategy_names():
        if strategy == "mixture":
            continue
        algorithm = find_algorithm(strategy)
        assert algorithm.kind == "guided"
        assert algorithm.changes["guide"]["strategy"] == strategy


@pytest.mark.parametrize(
    ("name", "near"), [("srep", "serp"), ("jumpstart", "jump-start"), ("drawin", "drawing")]
)
def test_a_name_that_does_not_exist_is_refused_with_a_near_one(
    name: str, near: str, guests: None
) -> None:
    with pytest.raises(SettingsError, match=f"no algorithm `{name}`; did you mean `{near}`"):
        find_algorithm(name)


def test_one_from_outside_is_described_by_the_first_line_of_its_docstring(guests: None) -> None:
    algorithm = find_algorithm("drawing")
    assert (algorithm.kind, algorithm.description) == ("guest", "Draws its actions")
    assert algorithm.make_guest is contest.drawing
    assert not algorithm.uses_model
    assert pickle.loads(pickle.dumps(algorithm)) == algorithm  # other processes need it


def test_one_that_cannot_be_loaded_is_named(guests: None) -> None:
    with pytest.raises(SettingsError, match=r"`broken` \(tests.serp.comparison.nosuch:make\)"):
        find_algorithm("broken")


def test_what_an_algorithm_needs_is_said_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    class Needy(EntryPoint):
        def load(self) -> Any:
            raise MissingExtra("a comparison with something", "something")

    monkeypatch.setattr(
        algorithms, "algorithm_entries", lambda: {"needy": Needy("needy", "x:y", GROUP)}
    )
    with pytest.raises(SerpError, match=r"pip install 'serp\[something\]'"):
        find_algorithm("needy")


def test_entries_are_listed_without_being_imported() -> None:
    found = algorithms.algorithm_entries()
    assert {"ppo", "sb3-dqn"} <= set(found)
    assert not set(found) & set(OWN)


def test_other_settings_make_another_algorithm() -> None:
    base = find_algorithm("dqfd")
    changed = ablation(base, "dqfd:learner.members=1", {"learner": {"members": 1}})
    assert (changed.name, changed.kind) == ("dqfd:learner.members=1", "guided")
    assert changed.changes["learner"] == {**base.changes["learner"], "members": 1}
    assert changed.changes["guide"] == base.changes["guide"]
    assert "members" not in base.changes["learner"]


def test_one_from_outside_has_no_settings_to_change(guests: None) -> None:
    with pytest.raises(SettingsError, match="`drawing` has no settings that serp could change"):
        ablation(find_algorithm("drawing"), "drawing:x", {"learner": {"members": 1}})


def test_the_second_of_two_changes_holds() -> None:
    first = {"a": {"x": 1, "y": 2}, "b": {"z": 3}}
    second = {"a": {"y": 4}, "c": {"w": 5}}
    assert merged(first, second) == {"a": {"x": 1, "y": 4}, "b": {"z": 3}, "c": {"w": 5}}
    assert merged(first, {}) == merged({}, first) == first
