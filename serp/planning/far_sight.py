"""The planner that sees far: a closed graph where there is one, else values of cells at leaves."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import MOST, Arrays, Saved, nested, part_of
from serp.model.flags import APPLICABLE, TERMINAL
from serp.model.transition_model import UNKNOWN, TransitionModel, Vector
from serp.planning.cell_graph import COARSEST, FINEST, CellGraph, Visited
from serp.planning.cells import NO_CELLS, CellValues, in_range, set_value
from serp.planning.closed_graph import MAX_EDGES, ClosedGraph
from serp.planning.edges import Bound, lookahead_nodes
from serp.planning.forecast import Forecast, score_of
from serp.planning.goal_search import GoalSearch
from serp.planning.lookahead import Lookahead
from serp.planning.preference import free_of_risk, hazard
from serp.settings import PlannerSettings

_MOST: Final = 8
"""Most pairs of episodes."""
_FEWEST: Final = 4
_PERIODS: Final = 100
"""Most control periods of an episode."""
_SURE: Final = 2.0
"""Standard errors of the mean difference after which no further pair is played."""


class Played(NamedTuple):
    """What an episode in the model came to.

    Attributes:
        value: Discounted sum of rewards.
        risk: Discounted sum of risks that are not accepted.
    """

    value: float
    risk: float


def favour_cells(lookahead: Lookahead, cells: CellValues, states: Vector) -> bool:
    """Return whether a lookahead acts better with values of cells at its leaves than without.

    Pairs of episodes begin in the same states, from all over `states` `[N, F]`, those that were
    visited. A pair counts if both episodes stay within what the model knows; with fewer than four
    the answer is no. The mean of their differences decides: less risk, or with equal risk more
    reward. The leaves of the lookahead are set.
    """
    starts = np.linspace(0, len(states) - 1, _MOST + 2).astype(np.intp)[1:-1]
    gains, risks = [], []
    for start in states[starts]:
        without = _play(lookahead, start, NO_CELLS, cells)
        found = without and _play(lookahead, start, cells, cells)
        if not (without and found):
            continue
        gains.append(found.value - without.value)
        risks.append(found.risk - without.risk)
        mean = float(np.mean(gains))
        if len(gains) >= _FEWEST:
            error = float(np.std(gains, ddof=1)) / math.sqrt(len(gains))
            if abs(mean) >= _SURE * error:
                break
    if len(gains) < _FEWEST:
        return False
    risk = float(np.mean(risks))
    return risk < 0.0 or (risk == 0.0 and float(np.mean(gains)) > 0.0)


def _play(
    lookahead: Lookahead, state: Vector, leaves: CellValues, cells: CellValues
) -> Played | None:
    """Play an episode; return None if it left what the model knows, or the range of `cells`."""
    model = lookahead.model
    discount, accepted = lookahead.settings.discount, lookahead.settings.accepted_risk
    lookahead.leaves = leaves
    value = risk = 0.0
    weight = 1.0
    for _ in range(_PERIODS):
        choice = lookahead.forecast(state).choice
        if choice < 0 or model.uncertainty(state)[choice] >= UNKNOWN:
            return None
        row, flags = model.transition(state.tolist(), choice)
        value += weight * row.pop()
        risk += weight * hazard(flags, accepted)
        if flags & TERMINAL:
            break
        weight *= discount
        state = np.array(row)
        if not in_range(cells, state, len(state)):
            return None
    return Played(value, risk)


_SHARE: Final = 0.25
"""Steps of the model that every decision earns, as a fraction of those that a lookahead predicts.
Their values have to be found, too, which takes about as long."""
_LEAST: Final = 250
"""Fewest steps of the model that a decision earns where the graph closes, so that it soon pays for
another one; they take a quarter of a millisecond."""
_SAVED: Final = 200_000
"""Most steps that are saved."""
_SMALL_GRAPH: Final = 20_000
"""Most edges of a closed graph at the first attempt. After a failure it is twice as many, and the
next attempt comes when `_PATIENCE` times as many decisions were made."""
_PATIENCE: Final = 4
_FIRST_TRIAL: Final = 250
"""Visited states after which the cells are first tried everywhere, and again whenever they are
twice as many."""
_GROWN: Final = 1.1
"""The cells are found again when so many times as many states were visited."""


class FarSightPlanner:
    """Plans on the closed graph where the best policy stays inside it, else by a lookahead.

    Where the lookahead sees the costs of actions alone, in a continuous domain, it is asked again
    with values of cells at its leaves. They come from interpolation, so they decide against what
    else it sees only where they were better in episodes that were played in the model.
    Every decision earns a fraction of the steps of the model that a lookahead predicts, or more
    where graphs close. Graph and cells are paid for with what was saved: so the mean cost of a
    decision is bounded, and what is built grows with experience. They are kept until the model has
    changed noticeably.

    Args:
        model: The transition model.
        settings: The settings of the planner.

    Attributes:
        model: As above.
        visited: The visited states; None if they are not known. Without them there are no cells.
        graph: The closed graph.
        search: The search for a way to the goal, where not everything that can be reached fits into
            the graph.
        cells: The graph of cells.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings) -> None:
        self.model, self._settings = model, settings
        self.visited: Visited | None = None
        self.graph = ClosedGraph(model, settings)
        self.search = GoalSearch(model, settings)
        self.cells = CellGraph(model, settings)
        self._near = Lookahead(model, settings)
        actions = len(model.actions)
        self._ahead = lookahead_nodes(settings, actions, len(model.fluents)) * actions
        self._share = _SHARE * settings.repeat
        self._periods = sum(settings.discount**k for k in range(settings.repeat))
        self._revision = model.revision
        self._saved = self._decisions = self._attempt_at = self._cells_at = 0
        self._limit, self._price = _SMALL_GRAPH, 1
        self._needed = 0
        self._closes = self._favoured = False
        self._trial_at = _FIRST_TRIAL

    @property
    def favours_cells(self) -> bool:
        """Whether values of cells decide wherever there are any, not only among equal plans."""
        return self._favoured

    def forecast(self, state: Vector) -> Forecast:
        """Return the forecast for a state `[F]`."""
        self._decisions += 1
        least = _LEAST if self._closes else 1
        self._saved = min(self._saved + max(least, int(self._share * self._ahead)), _SAVED)
        if self.model.revision != self._revision and self._saved >= 0:
            self._revision = self.model.revision
            self.graph.clear()
        found = self.graph.forecast(state)
        if found is None and self._decisions >= self._attempt_at and self._may_close(state):
            found = self._grow(state)
        return found if found is not None else self._forecast_by_cells(state)

    @contextlib.contextmanager
    def foreseeing(self, states: Sequence[Vector]) -> Iterator[None]:
        """Have the lookahead's forecasts for these states at hand in the body."""
        self._near.leaves = self.cells.values if self._looks_to_cells else NO_CELLS
        unknown = [state for state in states if self.graph.forecast(state) is None]
        with self._near.foreseeing(unknown):
            yield

    @property
    def _looks_to_cells(self) -> bool:
        """Whether the lookahead uses the cells wherever it is asked."""
        return self.visited is not None and self._favoured and not self.cells.explores

    def _may_close(self, state: Vector) -> bool:
        """Return whether another attempt at a closed graph is worth what it may cost.

        Between numbers that are not whole there are always others: most such graphs do not close.
        Where the newest one did, the next will take about as much.
        """
        if self._decisions == 1 or _whole(state):
            return self._saved >= 0
        return self._saved >= (self._needed if self._closes else self._limit)

    def _grow(self, state: Vector) -> Forecast | None:
        """Grow the closed graph, or build it anew; return its forecast if it has one."""
        graph, edges = self.graph, 0
        if not graph.complete:
            graph.clear()
        while True:
            before = graph.edges
            graph.grow(state, self._limit)
            edges += graph.edges - before
            found = graph.forecast(state)
            if found is not None or before == 0:
                break
            graph.clear()
        full = graph.edges >= self._limit
        # In a symbolic domain a graph spreads where many actions are applicable in any order.
        hopeless = graph.spreads and not _whole(state)
        if self.search.goal and not (graph.complete or hopeless or graph.ends(state)):
            found = self._search(state)
            edges += self.search.steps + self.graph.edges
        self._saved -= edges
        self._closes = found is not None and graph.complete
        if self._closes:
            self._needed = edges
        if found is None:
            if full:
                self._limit = min(2 * self._limit, MAX_EDGES)
            self._attempt_at = _PATIENCE * self._decisions
        return found

    def _search(self, state: Vector) -> Forecast | None:
        """Grow the graph around a way to the goal; return its forecast.

        Its values are then those of the best policy in the neighbourhood of the way (Nakhost &
        Müller, "Action elimination and plan neighborhood graph search", ICAPS 2010).
        """
        graph, found = self.graph, self.graph.forecast(state)
        way = self.search.way(state, MAX_EDGES)
        if way is None:
            if found is None or found.value[found.choice] > 0.0:
                return found
            graph.clear()  # a policy that stays inside and gains nothing
            return None
        graph.clear()
        graph.grow(way, _SMALL_GRAPH)
        return graph.forecast(state)

    def _forecast_by_cells(self, state: Vector) -> Forecast:
        near, visited, cells = self._near, self.visited, self.cells
        if visited is not None and (self._favoured or visited.seen >= self._trial_at):
            self._try_cells(state, visited)
        near.leaves = NO_CELLS
        if visited is None or not self._looks_to_cells:
            found = near.forecast(state)
            self._ahead = near.followed
            if visited is None or not found.sees_costs_alone(self._periods):
                return found
            if not self._find_cells(state, visited):
                return found
        near.leaves = cells.values
        found = near.forecast(state)
        if found.bound is Bound.DEPTH:  # else no leaf had a value of cells
            found = found._replace(bound=Bound.UNKNOWN if cells.explores else Bound.CELLS)
        if cells.explores:
            return self._to_the_unknown(state, found)
        if found.safe and found.bound is not Bound.NODES:
            set_value(cells.values, state, found.value[found.choice])
        return found

    def _find_cells(self, state: Vector, visited: Visited) -> bool:
        """Find the cells again where that is due and paid for; return whether there are any."""
        cells = self.cells
        if visited.seen >= self._cells_at and self._saved >= self._price:
            there_are = cells.build(state, visited.next_states, self._saved)
            self._price = min(_SAVED, cells.needed if there_are else 2 * self._saved)
            self._saved -= cells.steps
            self._cells_at = 1 + int(_GROWN * visited.seen)
        return cells.values.value.size > 0

    def _try_cells(self, state: Vector, visited: Visited) -> None:
        """Keep the cells up to date, and find out, where that is due, whether to favour them."""
        if self._find_cells(state, visited) and visited.seen >= self._trial_at:
            self._trial_at = 2 * visited.seen
            self._favoured = not self.cells.explores and favour_cells(
                self._near, self.cells.values, visited.next_states
            )

    def _to_the_unknown(self, state: Vector, found: Forecast) -> Forecast:
        """Return the forecast in which an unknown action has the value of the unknown."""
        unknown = (self.model.uncertainty(state) >= UNKNOWN) & free_of_risk(found.flags)
        if not unknown.any():
            return found
        hoped = found.reward + self._settings.discount * self.cells.values.value[-1]
        found = found._replace(value=np.where(unknown, hoped, found.value))
        applicable = np.flatnonzero(found.flags & APPLICABLE).tolist()
        return found._replace(choice=max(applicable, key=lambda action: score_of(found, action)))

    def state_dict(self) -> tuple[Arrays, dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        cells = self.cells
        arrays = nested("graph", self.graph.state_dict())
        arrays |= nested("cells", cells.values.state_dict())
        return arrays, {
            "saved": self._saved,
            "decisions": self._decisions,
            "attempt_at": self._attempt_at,
            "cells_at": self._cells_at,
            "limit": self._limit,
            "ahead": self._ahead,
            "price": self._price,
            "closes": self._closes,
            "needed": self._needed,
            "trial_at": self._trial_at,
            "favoured": self._favoured,
            "revision": self._revision,
            "bins": cells.bins,
            "explores": cells.explores,
        }

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It is damaged.
        """
        saved = Saved("planner", arrays, meta)
        self.graph.load_state_dict(part_of(arrays, "graph"))
        self._saved = saved.whole("saved", -MOST, _SAVED)
        self._decisions, self._revision = saved.whole("decisions"), saved.whole("revision")
        self._attempt_at, self._cells_at = saved.whole("attempt_at"), saved.whole("cells_at")
        self._limit, self._ahead = saved.whole("limit", 1, MAX_EDGES), saved.whole("ahead")
        self._price, self._closes = saved.whole("price", 0, _SAVED), saved.truth("closes")
        self._needed = saved.whole("needed")
        self._trial_at, self._favoured = saved.whole("trial_at"), saved.truth("favoured")
        cells = self.cells
        cells.bins, cells.explores = saved.real("bins", 0.0, FINEST), saved.truth("explores")
        if 0.0 < cells.bins < COARSEST:
            raise saved.wrong(f"bins is {cells.bins}")
        cells.values = CellValues.restored(part_of(arrays, "cells"), len(self.model.fluents))
        if self._favoured and not cells.values.value.size:
            raise saved.wrong("favoured is true, and there are no cells")


def _whole(state: Vector) -> bool:
    """Whether all values of a state `[F]` are whole numbers."""
    return bool((state == np.rint(state)).all())
