"""Planners, learners and strategies are found by name; adding one edits no file of serp."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from serp.agent.registry import find_learner, find_strategy, make_planner
from serp.errors import SettingsError
from serp.learning.dqn import DQN
from serp.planning.lookahead import Lookahead
from serp.settings import PlannerSettings
from tests.serp.planning.worlds import world

PACKAGE = "class NoStrategy: pass"
ENTRY_POINTS = """
[serp.strategies]
no-strategy = my_strategies:NoStrategy
not-there = my_strategies:Nothing
"""


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package whose strategies cannot be used; `tests.docs` installs one that can."""
    (tmp_path / "my_strategies.py").write_text(PACKAGE)
    info = tmp_path / "my_strategies-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-strategies\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "my_strategies", raising=False)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("mixtrue", "guide.strategy: there is no strategy `mixtrue`; did you mean `mixture`"),
        (
            "no-strategy",
            "guide.strategy: `no-strategy` is .*NoStrategy.*, which is not a subclass of .*Strat",
        ),
        ("not-there", r"`not-there` \(my_strategies:Nothing\) cannot be loaded: AttributeError"),
    ],
)
def test_what_cannot_be_used_is_refused(installed: None, name: str, said: str) -> None:
    with pytest.raises(SettingsError, match=said):
        find_strategy(name)


def test_planners_and_learners_are_found_alike() -> None:
    assert find_learner("dqn") is DQN
    with pytest.raises(SettingsError, match="learner.name: there is no learner `ddqn`; did you m"):
        find_learner("ddqn")
    assert isinstance(make_planner(world(0), PlannerSettings()), Lookahead)
    with pytest.raises(SettingsError, match="planner.name: there is no planner `look`"):
        make_planner(world(0), PlannerSettings(name="look"))
