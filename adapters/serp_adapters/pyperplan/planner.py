"""Plans by a search of pyperplan, followed while they hold.

The name of the planner is `pyperplan`, `pyperplan:SEARCH` or `pyperplan:SEARCH:HEURISTIC`, with
pyperplan's names of these.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

from pyperplan import planner as pyperplan
from pyperplan import task as pyperplan_task
from pyperplan.heuristics.lm_cut import LmCutHeuristic

from serp import SettingsError, TransitionModel
from serp._util.did_you_mean import did_you_mean
from serp.model.transition_model import Vector
from serp.planning.plan_follower import PlanFollower
from serp.settings import PlannerSettings
from serp_adapters.pyperplan.strips import Facts, Operator, Strips

SEARCHES: Final = {name: each for name, each in pyperplan.SEARCHES.items() if name != "sat"}
"""The searches by name. `sat` needs another program, and leaves Python where there is none."""
INFORMED: Final = ("astar", "ehs", "gbf", "wastar")
"""Searches that go by a heuristic."""
SEARCH, HEURISTIC = "gbf", "hff"


def make(model: TransitionModel, settings: PlannerSettings) -> PlanFollower:
    """Return the planner that follows plans found by pyperplan.

    Args:
        model: The transition model, with a goal.
        settings: `name` has search and heuristic; a search expands at most `max_nodes` states.

    Raises:
        SettingsError: There is no such search or heuristic.
        DomainError: There is no goal, or the domain is not symbolic.
    """
    search = Search(model, settings)
    return PlanFollower(model, settings, search.plan)


class Search:
    """A search of pyperplan in the ground model of a domain.

    Args:
        model: The transition model.
        settings: As for `make`.

    Attributes:
        strips: The ground model as facts and operators.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings) -> None:
        self._search, heuristic = _parts(settings.name)
        self._heuristic = None if heuristic is None else _HEURISTICS[heuristic]
        self._most = settings.max_nodes
        self.strips = Strips(model.ground, settings.name)
        # LM-cut prints its facts, and they must be texts for that.
        self._names = _Names() if self._heuristic is _LmCut else None

    def plan(self, state: Vector) -> Sequence[int] | None:
        """Return the ground actions of a plan from a state `[F]`; None where none was found."""
        start = self.strips.holding(state)
        usable = self.strips.reachable(start)
        if not usable:
            return None
        task = _Task(self.strips, start, usable, self._most, self._names)
        try:
            if self._heuristic is None:
                found = self._search(task)
            else:
                found = self._search(task, self._heuristic(task))
        except (_Spent, RecursionError):  # `ids` calls itself at every step
            return None
        if found is None:
            return None
        actions = [usable[step.name].action for step in found]
        return [action for action in actions if action >= 0]


class _Spent(Exception):
    """A search has expanded as many states as it may."""


class _Task(pyperplan_task.Task):  # type: ignore[misc]  # pyperplan has no types
    """A task of pyperplan that ends a search at a limit, and enters nothing forbidden."""

    def __init__(
        self,
        strips: Strips,
        start: Facts,
        operators: Sequence[Operator],
        most: int,
        names: _Names | None,
    ) -> None:
        def named(facts: Facts) -> frozenset[Any]:
            return facts if names is None else frozenset(names[fact] for fact in sorted(facts))

        made = [
            pyperplan_task.Operator(k, named(o.needs), named(o.adds), named(o.deletes))
            for k, o in enumerate(operators)
        ]
        super().__init__("serp", named(strips.facts), named(start), named(strips.goal), made)
        self._unsafe, self._ends, self._goals = (
            [named(way) for way in ways] for ways in (strips.unsafe, strips.ends, strips.goals)
        )
        self._left = most

    def get_successor_states(self, state: frozenset[Any]) -> list[tuple[Any, frozenset[Any]]]:
        self._left -= 1
        if self._left < 0:
            raise _Spent
        found: list[tuple[Any, frozenset[Any]]] = super().get_successor_states(state)
        if not (self._unsafe or self._ends):
            return found
        return [(operator, after) for operator, after in found if self._allowed(after)]

    def _allowed(self, state: frozenset[Any]) -> bool:
        if any(way <= state for way in self._unsafe):
            return False
        over = any(way <= state for way in self._ends)
        return not over or any(way <= state for way in self._goals)


class _Name(str):
    """The name of a fact; its hash, and so the order in a set, is the same in every process."""

    __slots__ = ()

    def __hash__(self) -> int:
        return int(self)


class _Names(dict[int, _Name]):
    """Fact → its name."""

    def __missing__(self, fact: int) -> _Name:
        name = self[fact] = _Name(fact)
        return name


class _LmCut(LmCutHeuristic):  # type: ignore[misc]  # pyperplan has no types
    """LM-cut, whose cuts are sets in the order of addresses; here they are ordered by name."""

    def find_cut(self, state: Any) -> list[Any]:
        return sorted(super().find_cut(state), key=lambda operator: str(operator.name))


_HEURISTICS: Final[dict[str, Callable[..., Any]]] = pyperplan.HEURISTICS | {"lmcut": _LmCut}


def _parts(name: str) -> tuple[Callable[..., Any], str | None]:
    """Return the search of a planner's name, and the name of the heuristic, if it takes one."""
    _, *parts = name.split(":")
    if len(parts) > 2:
        raise _wrong(name, "write `pyperplan:SEARCH:HEURISTIC`, such as `pyperplan:astar:lmcut`")
    search = parts[0] if parts else SEARCH
    if search not in SEARCHES:
        raise _wrong(name, f"there is no search `{search}`; {did_you_mean(search, SEARCHES)}")
    if search not in INFORMED:
        if len(parts) == 2:
            raise _wrong(name, f"`{search}` takes no heuristic; write `pyperplan:{search}`")
        return SEARCHES[search], None
    heuristic = parts[1] if len(parts) == 2 else HEURISTIC
    if heuristic not in _HEURISTICS:
        advice = did_you_mean(heuristic, _HEURISTICS)
        raise _wrong(name, f"there is no heuristic `{heuristic}`; {advice}")
    return SEARCHES[search], heuristic


def _wrong(name: str, why: str) -> SettingsError:
    return SettingsError(f"planner.name: `{name}`: {why}")
