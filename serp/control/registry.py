"""Planners, learners and strategies by name; each is an entry point of an installed package.

A package adds one by declaring it; serp needs no change::

    [project.entry-points."serp.strategies"]
    my-strategy = "my_package.strategy:MyStrategy"
"""

from __future__ import annotations

from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING, Any, Final, cast

from serp._util import plugins
from serp.errors import SettingsError

if TYPE_CHECKING:
    from serp.control.protocols import MakeLearner, MakePlanner, Planner
    from serp.control.strategies.strategy import Strategy
    from serp.model.transition_model import TransitionModel
    from serp.settings import PlannerSettings, Settings

PLANNERS: Final = "serp.planners"
LEARNERS: Final = "serp.learners"
STRATEGIES: Final = "serp.strategies"

KINDS: Final = {
    STRATEGIES: ("strategy", "guide.strategy"),
    PLANNERS: ("planner", "planner.name"),
    LEARNERS: ("learner", "learner.name"),
}
"""Entry-point group → what it offers, and the setting that chooses one by its name."""


def strategy_names() -> list[str]:
    """Return the names of all strategies, sorted."""
    return sorted(plugins.offered(STRATEGIES))


def find_strategy(name: str) -> type[Strategy]:
    """Return the strategy of a name, or raise a SettingsError."""
    from serp.control.strategies.strategy import Strategy

    found = _load(STRATEGIES, name)
    if not (isinstance(found, type) and issubclass(found, Strategy)):
        raise SettingsError(
            f"guide.strategy: `{name}` is {found!r}, which is not a subclass of {Strategy!r}"
        )
    return found


def make_planner(model: TransitionModel, settings: PlannerSettings) -> Planner:
    """Return the planner that `planner.name` names, or raise a SettingsError.

    What follows the first colon of the name is for the planner itself, such as an engine.
    """
    make = cast("MakePlanner", _load(PLANNERS, settings.name))
    return make(model, settings)


def find_learner(name: str) -> MakeLearner:
    """Return the function that makes the learner of a name, or raise a SettingsError."""
    return cast("MakeLearner", _load(LEARNERS, name))


def refuse_unknown_names(settings: Settings) -> None:
    """Raise a SettingsError for a planner, strategy or learner that is not installed.

    Nothing is imported for that.
    """
    _entry(PLANNERS, settings.planner.name)
    _entry(STRATEGIES, settings.guide.strategy)
    _entry(LEARNERS, settings.learner.name)


def _load(group: str, name: str) -> Any:
    entry = _entry(group, name)
    with plugins.loading(entry, KINDS[group][0], SettingsError):
        return entry.load()


def _entry(group: str, name: str) -> EntryPoint:
    what, setting = KINDS[group]
    if group == PLANNERS:
        name = name.partition(":")[0]
    return plugins.find(plugins.offered(group), name, what, SettingsError, setting=setting)
