"""The soak, a small one: see `tests.benchmarks.soak`."""

from collections import Counter

import numpy as np
import pytest

from serp.agent.veto import VetoPolicy
from tests.benchmarks import knocks, soak


def test_no_decision_in_a_random_world_breaks_the_guarantee(monkeypatch):
    """Under all strategies and planners, in learned models, and where a training goes on."""
    few = {"lookahead": 300, "far-sight": 100, "pyperplan": 20}
    monkeypatch.setattr(soak, "RANDOM_STATES", few)
    counts = sum(map(soak.soak_number, range(45, 60)), Counter())
    assert counts["decisions"] > 3_000
    assert counts["where only some are flagged"] > 300
    assert counts["in a learned model"] > 500


def test_without_vetoes_the_soak_fails(monkeypatch):
    monkeypatch.setattr(VetoPolicy, "admissible", lambda self, known: np.ones_like(known.safe))
    monkeypatch.setattr(soak, "shrunk", str)
    with pytest.raises(soak.Fault, match="is not safe, and another is"):
        soak.soak_number(54)


@pytest.mark.parametrize(("kind", "number"), [("kills", 8), ("disk", 3), ("torn", 8)])
def test_whatever_happens_to_a_run(kind, number, monkeypatch):
    """It goes on as if it had not, and what is torn changes no answer in silence."""
    monkeypatch.setattr(knocks, "ENV_STEPS", 300)
    monkeypatch.setattr(knocks, "READERS_A_FILE", 1)
    assert knocks.KINDS[kind](number)["runs refused"] == 0
