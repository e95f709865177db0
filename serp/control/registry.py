"""Planners, learners and strategies by name; each is an entry point of an installed package.

A package adds one by declaring it; serp needs no change::

    [project.entry-points."serp.strategies"]
    my-strategy = "my_package.strategy:MyStrategy"
"""

from __future__ import annotations

from typing import Any, Final, cast

from serp._util import plugins
from serp.control.protocols import MakeLearner, MakePlanner, Planner
from serp.control.strategies.strategy import Strategy
from serp.errors import SettingsError
from serp.model.transition_model import TransitionModel
from serp.settings import PlannerSettings

PLANNERS: Final = "serp.planners"
LEARNERS: Final = "serp.learners"
STRATEGIES: Final = "serp.strategies"


def strategy_names() -> list[str]:
    """Return the names of all strategies, sorted."""
    return sorted(plugins.offered(STRATEGIES))


def find_strategy(name: str) -> type[Strategy]:
    """Return the strategy of a name, or raise a SettingsError."""
    found = _load(STRATEGIES, name, "strategy", "guide.strategy")
    if not (isinstance(found, type) and issubclass(found, Strategy)):
        raise SettingsError(
            f"guide.strategy: `{name}` is {found!r}, which is not a subclass of {Strategy!r}"
        )
    return found


def make_planner(model: TransitionModel, settings: PlannerSettings) -> Planner:
    """Return the planner that `planner.name` names, or raise a SettingsError."""
    make = cast(MakePlanner, _load(PLANNERS, settings.name, "planner", "planner.name"))
    return make(model, settings)


def find_learner(name: str) -> MakeLearner:
    """Return the function that makes the learner of a name, or raise a SettingsError."""
    return cast(MakeLearner, _load(LEARNERS, name, "learner", "learner.name"))


def _load(group: str, name: str, what: str, setting: str) -> Any:
    entry = plugins.find(plugins.offered(group), name, what, SettingsError, setting=setting)
    with plugins.loading(entry, what, SettingsError):
        return entry.load()
