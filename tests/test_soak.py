"""The soak, a small one: see `tests.benchmarks.soak`."""

from collections import Counter

import pytest

from tests.benchmarks import knocks, soak


def test_no_decision_in_a_random_world_breaks_the_guarantee():
    """Under all strategies and planners, in learned models, and where a training goes on."""
    counts = sum(map(soak.soak_number, range(20)), Counter())
    assert counts["decisions"] > 15_000
    assert counts["flagged"] > 1_000
    assert counts["in a learned model"] > 1_000
    assert counts["resumed"] > 0


@pytest.mark.parametrize(("kind", "number"), [("kills", 8), ("disk", 3), ("torn", 8)])
def test_whatever_happens_to_a_run(kind, number, monkeypatch):
    """It goes on as if it had not, and what is torn changes no answer in silence."""
    monkeypatch.setattr(knocks, "ENV_STEPS", 300)
    monkeypatch.setattr(knocks, "READERS_A_FILE", 1)
    assert knocks.KINDS[kind](number)["runs refused"] == 0
