"""The planner that sees far: a closed graph where there is one, else values of cells at leaves."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._core import CellValues
from serp._util.saved_state import MOST, Arrays, Saved, nested, part_of
from serp.model.flags import APPLICABLE
from serp.model.learned.transitions import TransitionMemory
from serp.model.transition_model import UNKNOWN, TransitionModel, Vector
from serp.planning.cell_graph import CellGraph
from serp.planning.closed_graph import MAX_EDGES, ClosedGraph
from serp.planning.forecast import Bound, Forecast, advised, score_of
from serp.planning.goal_search import GoalSearch
from serp.planning.lookahead import Lookahead, near_lookahead
from serp.planning.preference import free_of_risk
from serp.settings import PlannerSettings

_SHARE: Final = 0.25
"""Steps of the model that a decision earns, as a fraction of those that a lookahead predicts."""
_LEAST: Final = 250
"""Fewest steps of the model that a decision earns while searches find a way."""
_MOST_SAVED: Final = 200_000
"""Most steps that are saved."""
_SMALL_GRAPH: Final = 20_000
"""Most edges of a closed graph at the first attempt."""
_PATIENCE: Final = 4
"""After a search that found no way, the next one comes after so many times as many decisions, with
so many times as many edges."""
_MOST_WORK: Final = 4 * MAX_EDGES
"""Most steps of the model of a decision; so many take about four seconds."""
_MENDED: Final = 20_000
"""Most steps of the model to find a way back to one that was left."""
_LONGEST: Final = 2_000
"""Most actions of a way that is gone back to."""
_FAR: Final = 100
"""After so many decisions toward a state that is only nearer to the goal, the search goes on."""
_GROWN: Final = 1.1
"""The cells are found again when so many times as many states were visited."""


class FarSightPlanner:
    """Plans on the closed graph where the best policy stays inside it, else by a lookahead.

    Where the lookahead sees the costs of actions alone, in a continuous domain, it is asked again
    with values of cells at its leaves.

    Searches have a budget of work, which is counted in steps of the model, so that decisions do not
    depend on the speed of the machine. Every decision earns a share of the steps that a lookahead
    predicts; graphs for a changed model, cells, and searches between numbers that are not whole are
    paid for. Between whole numbers a search that found a way has earned the next one; after one
    that found none, the next comes after exponentially many decisions, or in the next episode.

    Attributes:
        visited: The visited states; None if they are not known. Without them there are no cells.
        graph: The closed graph.
        goal_search: The search for a way to the goal, where not everything that can be reached fits
            into the graph.
        cells: The graph of cells.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings) -> None:
        self.model, self._settings = model, settings
        self.visited: TransitionMemory | None = None
        self.graph = ClosedGraph(model, settings)
        self.goal_search = GoalSearch(model, settings)
        self.cells = CellGraph(model, settings)
        self._lookahead, self._near = Lookahead(model, settings), near_lookahead(model, settings)
        self._followed = self._lookahead.followed
        self._revision = model.revision
        self._new_episode = True
        self._checked: Vector | None = None
        self._before: Vector | None = None  # where the world was at the decision before
        self._since = self._wait = 0  # decisions since the last way was found, and before a search
        self._saved = self._price = self._cells_at = 0
        self._cells_price = 1

    @property
    def farther(self) -> bool:
        """Whether the lookahead looks farther for what is safe, see `Lookahead.farther`."""
        return self._lookahead.farther

    @farther.setter
    def farther(self, farther: bool) -> None:
        self._lookahead.farther = farther

    def begin_episode(self) -> None:
        """Say that another episode begins, perhaps in another world, which is searched anew."""
        self._new_episode = True
        self._before = None
        self.goal_search.forget()

    def forecast(self, state: Vector) -> Forecast:
        """Return the forecast for a state `[F]`; a decision that was checked has earned already."""
        if state is not self._checked:
            self._earn()
        self._checked = None
        forecast = self._forecast_by_graph(state)
        if forecast is None and self._is_astray(state) and self._may_search(state):
            forecast = self._search(state)
        self._before = state.copy()
        if forecast is not None:
            return forecast
        action = self.goal_search.toward(state)
        if action >= 0:
            return advised(self._near.forecast(state), action)
        return self._forecast_by_cells(state)

    def check_safety(self, state: Vector) -> Forecast | None:
        """Return which actions are safe in a state `[F]`; None where that takes a forecast.

        See `Lookahead.check_safety`. A state that the graph holds has its forecast.
        """
        forecast = self._forecast_by_graph(state)
        # A graph of a former model is not replaced before a forecast pays for that.
        if self.model.revision != self._revision or (forecast is None and self._may_search(state)):
            return None
        if forecast is None:
            forecast = self._lookahead.check_safety(state)
        if forecast is not None:  # else the planner plans, and earns
            self._checked = state
            self._earn()
        return forecast

    def _earn(self) -> None:
        """Count a decision, and save what it earns."""
        self._since += 1
        least = 1 if self._wait else _LEAST
        self._saved = min(self._saved + max(least, int(_SHARE * self._followed)), _MOST_SAVED)

    def _forecast_by_graph(self, state: Vector) -> Forecast | None:
        """Return the forecast of the graph, which is forgotten where the model has changed."""
        if self.model.revision != self._revision and (self._saved >= 0 or not self.graph.nodes):
            self._revision = self.model.revision
            self.graph.clear()
            self.goal_search.forget()
        if not self.graph.complete and self._misses_goal(state):
            return None  # a part of a graph, as after a slip: a search may find a way
        return self.graph.forecast(state)

    def _misses_goal(self, state: Vector) -> bool:
        """Return whether there is a goal that the graph's best policy does not reach."""
        return self.model.ground.goal is not None and not self.graph.ends(state)

    @contextlib.contextmanager
    def prefetch(self, states: Sequence[Vector]) -> Iterator[None]:
        """Have the lookahead's forecasts for these states at hand in the body."""
        self._lookahead.leaves = None
        unknown = [state for state in states if self.graph.forecast(state) is None]
        with self._lookahead.prefetch(unknown):
            yield

    def _is_astray(self, state: Vector) -> bool:
        """Return whether no known way leads on, or the goal was not seen for many decisions."""
        search = self.goal_search
        return search.toward(state) < 0 or (self._since >= _FAR and search.least > 0.0)

    def _may_search(self, state: Vector) -> bool:
        """Return whether a search is due: between numbers that are not whole most find nothing."""
        if not self._symbolic(state):
            return self._since >= self._wait and self._saved >= self._price
        if self._new_episode:
            self._since, self._wait = 1, 0
        return self._since >= self._wait

    def _symbolic(self, state: Vector) -> bool:
        """Return whether a search is likely to find the goal: in the file, or all is whole."""
        return self.model.ground.goal is not None or bool((state == np.rint(state)).all())

    def _search(self, state: Vector) -> Forecast | None:
        """Grow the closed graph, or the graph around a way to the goal; return its forecast."""
        graph, limit = self.graph, min(_SMALL_GRAPH * max(1, self._wait), MAX_EDGES)
        least = np.inf if self._new_episode else self.goal_search.least
        self._new_episode = False
        plan = self._plan() if self.goal_search.goal else []
        way = self.goal_search.way(state, _MENDED, plan) if plan else None
        work = self.goal_search.steps if plan else 0
        if way is not None:
            forecast = self._beside(way, state)
            self._since, self._wait = 0, 0
            self._saved = max(self._saved, 0) - work - graph.work
            return forecast
        if not graph.complete:
            graph.clear()
        while True:
            before = graph.work
            graph.grow(state, limit)
            work += graph.work - before
            forecast = graph.forecast(state)
            if forecast is not None or before == 0:
                break
            graph.clear()
        # In a symbolic domain a graph spreads where many actions are applicable in any order.
        hopeless = graph.spreads and not self._symbolic(state)
        if self.goal_search.goal and not (graph.complete or hopeless or graph.ends(state)):
            way = self.goal_search.way(state, _MOST_WORK - work)
            work += self.goal_search.steps
            if way is not None:
                forecast = self._beside(way, state)
                work += graph.work
            elif forecast is not None and forecast.value[forecast.choice] <= 0.0:
                graph.clear()  # a policy that stays inside and gains nothing
                forecast = None
        self._saved = max(self._saved, 0) - work
        self._price = limit if forecast is None else work
        if forecast is not None or self.goal_search.least < least:  # that earns the next search
            self._since, self._wait = 0, 0
        else:
            self._wait = _PATIENCE * max(1, self._wait)
        return forecast

    def _beside(self, way: Vector, state: Vector) -> Forecast | None:
        """Grow the graph around a way and return its forecast; None where the way is followed.

        Its values are those of the best policy in the neighbourhood of the way (Nakhost & Müller,
        "Action elimination and plan neighborhood graph search", ICAPS 2010).
        """
        self.graph.clear()
        self.graph.grow(way, _SMALL_GRAPH)
        forecast = self.graph.forecast(state)
        if forecast is None or self._misses_goal(state):
            self.graph.clear()  # costs or the discount hide the goal from it: the way is followed
            return None
        self.goal_search.forget()
        return forecast

    def _plan(self) -> list[int]:
        """Return the actions that led to the goal from where the world was; empty: none did."""
        plan: dict[bytes, int] = {}  # by states: a policy that comes to one again goes round
        state, model = self._before, self.model
        while state is not None and len(plan) < _LONGEST and (key := state.tobytes()) not in plan:
            forecast = self.graph.forecast(state)
            action = self.goal_search.toward(state) if forecast is None else forecast.choice
            if action < 0:
                break
            plan[key] = action
            outcome = model.step(state, action)
            state = outcome.state
            if outcome.terminal:
                return list(plan.values()) if outcome.reward > 0.0 else []
        return []

    def _forecast_by_cells(self, state: Vector) -> Forecast:
        lookahead, visited, cells = self._lookahead, self.visited, self.cells
        lookahead.leaves = None
        forecast = lookahead.forecast(state)
        self._followed = lookahead.followed
        if visited is None or not forecast.sees_costs_alone:
            return forecast
        values = self._find_cells(state, visited)
        if values is None:
            return forecast
        lookahead.leaves = values
        forecast = lookahead.forecast(state)
        if forecast.bound is Bound.DEPTH:  # else no leaf had a value of cells
            forecast = forecast._replace(bound=Bound.UNKNOWN if cells.explores else Bound.CELLS)
        if cells.explores:
            return self._to_the_unknown(state, forecast, values.unknown)
        if forecast.safe and forecast.bound is not Bound.NODES:
            values.set(state, forecast.value[forecast.choice])
        return forecast

    def _find_cells(self, state: Vector, visited: TransitionMemory) -> CellValues | None:
        """Return the values of the cells, found again where that is due and paid for."""
        cells = self.cells
        if visited.seen >= self._cells_at and self._saved >= self._cells_price:
            built = cells.build(state, visited.next_states, self._saved)
            self._cells_price = min(_MOST_SAVED, cells.needed if built else 2 * self._saved)
            self._saved -= cells.steps
            self._cells_at = 1 + int(_GROWN * visited.seen)
        return cells.values

    def _to_the_unknown(self, state: Vector, forecast: Forecast, value: float) -> Forecast:
        """Return the forecast in which an unknown action leads to what is worth `value`."""
        unknown = (self.model.uncertainty(state) >= UNKNOWN) & free_of_risk(forecast.flags)
        if not unknown.any():
            return forecast
        hoped = forecast.reward + self._settings.discount * value
        forecast = forecast._replace(value=np.where(unknown, hoped, forecast.value))
        applicable = np.flatnonzero(forecast.flags & APPLICABLE).tolist()
        return forecast._replace(choice=max(applicable, key=lambda a: score_of(forecast, a)))

    def state_dict(self) -> tuple[Arrays, dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        cells, meta = self.cells.state_dict()
        arrays = nested("graph", self.graph.state_dict()) | nested("cells", cells)
        arrays |= nested("goal", self.goal_search.state_dict())
        arrays["before"] = np.zeros(0) if self._before is None else self._before
        meta |= {name: getattr(self, f"_{name}") for name in _COUNTS}
        return arrays, meta | {"saved": self._saved, "new_episode": self._new_episode}

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It is damaged.
        """
        saved = Saved("planner", arrays, meta)
        self.graph.load_state_dict(part_of(arrays, "graph"))
        self.goal_search.load_state_dict(part_of(arrays, "goal"))
        before = saved.array("before", np.float64, (-1,))
        if len(before) not in (0, len(self.model.fluents)):
            raise saved.wrong(f"before has {len(before)} numbers")
        self._before = before if len(before) else None
        for name in _COUNTS:
            setattr(self, f"_{name}", saved.whole(name))
        self._saved = saved.whole("saved", -MOST, _MOST_SAVED)
        self._new_episode = saved.truth("new_episode")
        self.cells.load_state_dict(part_of(arrays, "cells"), meta)


_COUNTS: Final = ("since", "wait", "price", "cells_at", "cells_price", "followed", "revision")
