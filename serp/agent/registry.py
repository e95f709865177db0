"""Planners, learners and strategies by name; each is an entry point of an installed package.

A package adds one by declaring it; serp needs no change::

    [project.entry-points."serp.strategies"]
    my-strategy = "my_package.strategy:MyStrategy"
"""

from __future__ import annotations

import functools
from collections.abc import Collection, Mapping
from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING, Any, Final, cast

from serp._util import plugins
from serp._util.did_you_mean import listed
from serp.agent.protocols import Learner, MakeLearner, MakePlanner, Planner, Stateful
from serp.agent.strategy import Strategy
from serp.errors import SettingsError
from serp.model.transition_model import TransitionModel
from serp.planning.far_sight import FarSightPlanner
from serp.planning.lookahead import Lookahead
from serp.planning.plan_follower import Advise, AdvisedPlanner
from serp.settings import PlannerSettings, Settings

if TYPE_CHECKING:
    from serp.tasks.task import Task


def lookahead(model: TransitionModel, settings: PlannerSettings) -> Planner:
    """Return the planner that looks some steps ahead."""
    return Lookahead(model, settings)


def far_sight(model: TransitionModel, settings: PlannerSettings) -> Planner:
    """Return the planner that sees to the end of a finite task, or far into a continuous one."""
    return FarSightPlanner(model, settings)


PLANNERS: Final = "serp.planners"
LEARNERS: Final = "serp.learners"
STRATEGIES: Final = "serp.strategies"

KINDS: Final = {
    STRATEGIES: ("strategy", "guide.strategy"),
    PLANNERS: ("planner", "planner.name"),
    LEARNERS: ("learner", "learner.name"),
}
"""Entry-point group → what it offers, and the setting that chooses one by its name."""


def find_strategy(name: str) -> type[Strategy]:
    """Return the strategy of a name, or raise a SettingsError."""
    strategy = _load(STRATEGIES, name)
    if not (isinstance(strategy, type) and issubclass(strategy, Strategy)):
        raise SettingsError(
            f"guide.strategy: `{name}` is {strategy!r}, which is not a subclass of {Strategy!r}"
        )
    return strategy


def make_planner(
    model: TransitionModel, settings: PlannerSettings, own: Mapping[str, Advise] | None = None
) -> Planner:
    """Return the planner that `planner.name` names, or raise a SettingsError.

    What follows the first colon of a name is for the planner itself, such as an engine.

    Args:
        model: The transition model.
        settings: The settings of the planner.
        own: `serp.Task.planners`: functions of the fluents' values, by name.
    """
    if own and settings.name in own:
        return AdvisedPlanner(model, settings, own[settings.name])
    return cast(MakePlanner, _load(PLANNERS, settings.name))(model, settings)


def find_learner(name: str, own: Mapping[str, MakeLearner] | None = None) -> MakeLearner:
    """Return the function that makes the learner of a name, or raise a SettingsError.

    `own` is `serp.Task.learners`.
    """
    make = own[name] if own and name in own else _load(LEARNERS, name)
    return functools.partial(_made_learner, name, make)


def _made_learner(name: str, make: MakeLearner, *numbers: Any, **options: Any) -> Learner:
    """Return the learner that a function makes; refuse one that lacks a method."""
    given = "(input_size, action_count, settings, seed, imitates=..., discount=...)"
    with plugins.blaming(f"learner `{name}`, called with {given}", SettingsError):
        made = make(*numbers, **options)
    wanted = {each for of in (Stateful, Learner) for each in (*vars(of), *of.__annotations__)}
    if lacks := sorted(each for each in wanted if each[0] != "_" and not hasattr(made, each)):
        raise SettingsError(f"learner `{name}`: {type(made).__name__} has no {listed(lacks, 20)}")
    return made


def refuse_unknown_names(settings: Settings, task: Task | None = None) -> None:
    """Raise a SettingsError for a planner, strategy or learner that does not exist.

    Nothing is imported for that. The task may bring planners and learners along.
    """
    planners, learners = ({}, {}) if task is None else (task.planners, task.learners)
    if settings.planner.name not in planners:
        _entry(PLANNERS, settings.planner.name, planners)
    _entry(STRATEGIES, settings.guide.strategy)
    if settings.learner.name not in learners:
        _entry(LEARNERS, settings.learner.name, learners)


def _load(group: str, name: str) -> Any:
    entry = _entry(group, name)
    with plugins.loading(entry, KINDS[group][0], SettingsError):
        return entry.load()


def _entry(group: str, name: str, own: Collection[str] = ()) -> EntryPoint:
    what, setting = KINDS[group]
    if group == PLANNERS:
        name = name.partition(":")[0]
    entries = plugins.offered(group)
    return plugins.find(entries, name, what, SettingsError, known=own, setting=setting)
