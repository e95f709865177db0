"""Planners that a task brings along: functions of a state, and further domain files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import Arrays, Saved, nested
from serp._util.text import did_you_mean
from serp.agent.protocols import (
    EpisodicPlanner,
    ExperiencedPlanner,
    Planner,
    StatefulPlanner,
)
from serp.errors import TaskError
from serp.model.domain import Domain
from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.planning.cell_graph import Visited
from serp.planning.far_sight import FarSightPlanner
from serp.planning.forecast import Forecast
from serp.planning.plan_follower import Advise, AdvisedPlanner
from serp.settings import PlannerSettings

if TYPE_CHECKING:
    from serp.agent.protocols import MakePlanner


def own_planners(declared: Mapping[str, Any]) -> dict[str, MakePlanner]:
    """Return what makes the planners of `serp.Task.planners`, by name; their files are loaded.

    Raises:
        TaskError: A planner is neither a function nor a file, or its name cannot be a planner's.
    """
    made: dict[str, MakePlanner] = {}
    for name, given in declared.items():
        if not isinstance(name, str) or not name.strip() or set(name) & set("+:"):
            raise TaskError(
                f"planners: {name!r} cannot name a planner; take a word without `+` and `:`"
            )
        if callable(given):
            made[name] = partial(_by_function, name, given)
        elif isinstance(given, Domain):
            made[name] = partial(FilePlanner, name, given)
        else:
            raise TaskError(f"planners: `{name}` must be a function or a file, not {given!r}")
    return made


def _by_function(
    name: str, advise: Advise, model: TransitionModel, settings: PlannerSettings
) -> AdvisedPlanner:
    """Return a planner that follows a function of the fluents' values."""

    def advice(state: Vector) -> int:
        try:
            action = advise(model.values(state))
        except Exception as error:
            raise TaskError(f"planner `{name}`: {type(error).__name__}: {error}") from error
        try:
            return -1 if action is None else model.action_index(action)
        except StateError as error:
            raise TaskError(f"planner `{name}` advises {action!r}: {error}") from None

    return AdvisedPlanner(model, settings, advice)


class FilePlanner(AdvisedPlanner):
    """Follows what another domain file of the same task suggests.

    The task's own file says what is unsafe. The other one may know fewer fluents and actions.

    Args:
        name: Name of the planner, for messages.
        domain: The other domain.
        model: The model of the task's own file.
        settings: The settings of both planners.

    Raises:
        DomainError: It is wrong.
        TaskError: It has a fluent or an action that the task's own file has not.
    """

    def __init__(
        self, name: str, domain: Domain, model: TransitionModel, settings: PlannerSettings
    ) -> None:
        observed = [fluent.name for fluent in model.fluents]
        other = domain.observed(observed).model.replace(dt=model.dt)
        self._fluents = _positions(name, "fluent", [f.name for f in other.fluents], observed)
        for fluent, position in zip(other.fluents, self._fluents, strict=True):
            if fluent.numeric != model.fluents[position].numeric:
                raise TaskError(
                    f"planner `{name}`: `{fluent.name}` is a number in one of its file and the "
                    "task's own file, and a predicate in the other"
                )
        self._actions = _positions(
            name, "action", [a.name for a in other.actions], [a.name for a in model.actions]
        )
        self._other = FarSightPlanner(other, settings)
        super().__init__(model, settings, self._suggest)

    def _suggest(self, state: Vector) -> int:
        choice = self._other.forecast(np.ascontiguousarray(state[self._fluents])).choice
        return self._actions[choice] if choice >= 0 else -1

    def begin_episode(self) -> None:
        """Say that an episode begins, perhaps in another world."""
        self._other.begin_episode()

    def state_dict(self) -> tuple[Arrays, dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        return self._other.state_dict()

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It is damaged.
        """
        self._other.load_state_dict(arrays, meta)


def _positions(planner: str, what: str, names: list[str], known: list[str]) -> list[int]:
    position = {name: k for k, name in enumerate(known)}
    for name in names:
        if name not in position:
            raise TaskError(
                f"planner `{planner}`: its file has the {what} `{name}`, which the task's own file "
                f"does not have; {did_you_mean(name, known)}"
            )
    return [position[name] for name in names]


class Ensemble:
    """Partial teachers, of which one leads at a time.

    Which one, the strategy finds out: a teacher that is better in some situations or on average is
    not known beforehand (Kurenkov et al., "AC-Teach", 2019, arXiv 1909.04121).

    Args:
        members: The planners, at least one.
        best: Returns the position of the one that is best by what is known.
    """

    def __init__(self, members: list[Planner], best: Callable[[], int]) -> None:
        self._members = members
        self._best = best

    def led_by(self, member: int) -> Planner:
        """Return a planner by its position."""
        return self._members[member]

    def forecast(self, state: Vector) -> Forecast:
        """Return the forecast of the best planner for a state `[F]`."""
        return self._members[self._best()].forecast(state)

    def begin_episode(self) -> None:
        """Say that an episode begins, perhaps in another world."""
        for member in self._members:
            if isinstance(member, EpisodicPlanner):
                member.begin_episode()

    @property
    def visited(self) -> Visited | None:
        """The visited states, for the planners that use them."""
        found = (m.visited for m in self._members if isinstance(m, ExperiencedPlanner))
        return next(found, None)

    @visited.setter
    def visited(self, visited: Visited | None) -> None:
        for member in self._members:
            if isinstance(member, ExperiencedPlanner):
                member.visited = visited

    def state_dict(self) -> tuple[Arrays, dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays: Arrays = {}
        meta: dict[str, Any] = {}
        for name, member in self._stateful():
            found, meta[name] = member.state_dict()
            arrays |= nested(name, found)
        return arrays, meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It is damaged.
        """
        saved = Saved("planners", arrays, meta)
        for name, member in self._stateful():
            member.load_state_dict(*saved.part(name))

    def _stateful(self) -> list[tuple[str, StatefulPlanner]]:
        members = enumerate(self._members)
        return [(str(k), m) for k, m in members if isinstance(m, StatefulPlanner)]
