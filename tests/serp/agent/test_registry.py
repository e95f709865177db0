"""Planners, learners and strategies are found by name; `tests.docs` installs another strategy."""

from importlib.metadata import EntryPoint

import pytest

from serp._util import plugins
from serp.agent.registry import STRATEGIES, find_learner, find_strategy, make_planner
from serp.errors import SettingsError
from serp.learning.dqn import DQN
from serp.planning.lookahead import Lookahead
from serp.settings import PlannerSettings
from tests.serp.planning.worlds import world


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("mixtrue", "guide.strategy: there is no strategy `mixtrue`; did you mean `mixture`"),
        ("pathlib:Path", "guide.strategy: `own` is .*Path.*, which is not a subclass of .*Strat"),
        ("pathlib:Nothing", r"`own` \(pathlib:Nothing\) cannot be loaded: AttributeError"),
    ],
)
def test_what_cannot_be_used_is_refused(
    name: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if ":" in name:
        own = {"own": EntryPoint("own", name, STRATEGIES)}
        monkeypatch.setattr(plugins, "offered", lambda group: own)
        name = "own"
    with pytest.raises(SettingsError, match=said):
        find_strategy(name)


def test_planners_and_learners_are_found_alike() -> None:
    assert find_learner("dqn") is DQN
    with pytest.raises(SettingsError, match="learner.name: there is no learner `ddqn`; did you m"):
        find_learner("ddqn")
    assert isinstance(make_planner(world(0), PlannerSettings()), Lookahead)
    with pytest.raises(SettingsError, match="planner.name: there is no planner `look`"):
        make_planner(world(0), PlannerSettings(name="look"))
