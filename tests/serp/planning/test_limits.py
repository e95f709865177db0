from __future__ import annotations

import pytest

from serp.planning.limits import MAX_EDGES, MAX_NUMBERS, edge_budget, node_budget


@pytest.mark.parametrize("fluents", [0, 1, 15, 1_000, 200_000])
def test_the_edge_budget_bounds_the_numbers_of_a_graph(fluents: int) -> None:
    assert 1 <= edge_budget(fluents) * (fluents + 1) <= MAX_NUMBERS


@pytest.mark.parametrize("actions", [0, 1, 3, 1_000, 10_000_000])
def test_the_node_budget_bounds_the_edges(actions: int) -> None:
    budget = node_budget(10**9, actions)
    assert budget == 1 or 0 <= budget * actions <= MAX_EDGES
