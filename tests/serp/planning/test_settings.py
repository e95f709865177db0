from __future__ import annotations

import numpy as np
import pytest

from serp.errors import SettingsError
from serp.planning.settings import MAX_EDGES, MAX_NUMBERS, PlannerSettings


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("depth", 0),
        ("depth", 2.0),
        ("depth", True),
        ("depth", "5"),
        ("repeat", 0),
        ("max_nodes", -1),
        ("discount", 0.0),
        ("discount", 1.01),
        ("discount", float("nan")),
        ("discount", "high"),
        ("depth", True),
        ("depth", "3"),
        ("depth", 10_001),
        ("repeat", 10**30),
        ("leaf_value", "sometimes"),
        ("leaf_value", "Always"),
        ("leaf_value", ""),
        ("leaf_value", None),
        ("leaf_value", True),
        ("leaf_value", ["always"]),
    ],
)
def test_a_value_outside_its_range_is_refused_by_name(name: str, value: object) -> None:
    with pytest.raises(SettingsError, match=name):
        PlannerSettings(**{name: value})  # type: ignore[arg-type]


def test_a_leaf_value_that_does_not_exist_is_refused_with_those_that_do() -> None:
    with pytest.raises(SettingsError, match="never or indifferent or always, not 'sometimes'"):
        PlannerSettings(leaf_value="sometimes")  # type: ignore[arg-type]
    assert PlannerSettings().leaf_value == "never"


def test_the_ends_of_the_ranges_are_allowed() -> None:
    settings = PlannerSettings(depth=1, discount=1.0, repeat=1, max_nodes=1)
    assert settings.node_budget(5) == 1


def test_numbers_of_numpy_are_numbers() -> None:
    settings = PlannerSettings(
        depth=np.int64(3),  # type: ignore[arg-type]
        discount=np.float32(0.5),  # type: ignore[arg-type]
    )
    assert settings == PlannerSettings(depth=3, discount=0.5)
    assert type(settings.depth) is int and type(settings.discount) is float


@pytest.mark.parametrize("fluents", [0, 1, 15, 1_000, 200_000])
def test_the_edge_budget_bounds_the_numbers_of_a_graph(fluents: int) -> None:
    assert 1 <= PlannerSettings().edge_budget(fluents) * (fluents + 1) <= MAX_NUMBERS


@pytest.mark.parametrize("actions", [0, 1, 3, 1_000, 10_000_000])
def test_the_node_budget_bounds_the_edges(actions: int) -> None:
    settings = PlannerSettings(max_nodes=10**9)
    budget = settings.node_budget(actions)
    assert budget >= 1
    assert budget == 1 or budget * actions <= MAX_EDGES
