"""The planner of the paper without objects: the decisions of the planning graph, compiled."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp import _core
from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.planning.forecast import Bound, Forecast, forecast_of
from serp.settings import PlannerSettings

MAX_EDGES: Final = 4_000_000
"""Most edges that are tried."""
MAX_NUMBERS: Final = 10_000_000
"""Most numbers in all states that the edges of a graph lead to."""
_CORES = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
_WORTH = 500
"""Most edges of a search from which on threads save time; so many take about 0.1 ms."""


def _most_nodes(settings: PlannerSettings, actions: int, fluents: int, outcomes: int = 1) -> int:
    """Return the most nodes that a lookahead expands: the budget, or the whole tree if smaller.

    Every node but the root has an edge that leads to it, or to as many as an edge has outcomes.
    """
    by_edges = min(MAX_EDGES // max(1, actions), edge_budget(fluents) + 1)
    budget = max(1, min(settings.max_nodes, by_edges))
    tree, layer = 0, 1
    for _ in range(settings.depth):
        tree += layer
        layer *= max(1, actions * outcomes)
        if tree >= budget:
            return budget
    return tree


def edge_budget(fluents: int) -> int:
    """Return the most edges of a graph whose states have `fluents` numbers.

    This bounds the memory: a layer that would exceed it is dropped, as by `max_nodes`.
    """
    return MAX_NUMBERS // (fluents + 1)


class BestPath(NamedTuple):
    """The best path from a state, as in `Forecast`, and its first action; -1 for none."""

    value: float
    risk: float
    safe_steps: int
    action: int


class Lookahead:
    """Monitor-replanning, for use in every step of a training.

    Memory is bounded by the budgets of nodes and edges, and used again. Not thread-safe: give each
    thread its own.

    Attributes:
        leaves: The values of the states that the last layer leads to. Without any (None) they are
            0, and all decisions are those of the planning graph.
        followed: Edges that the newest forecast followed; before the first one, the most.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings | None = None) -> None:
        self.model = model
        self.settings = settings or PlannerSettings()
        self.leaves: _core.CellValues | None = None
        self._width, actions = len(model.fluents), len(model.actions)
        nodes = _most_nodes(self.settings, actions, self._width, outcomes=2)
        self.followed = self._most = _most_nodes(self.settings, actions, self._width) * actions
        self._core = _core.Lookahead(
            model.core, self.settings.depth, self.settings.discount, self.settings.accepted_risk,
            nodes, edge_budget(self._width),
        )  # fmt: skip
        self._prefetched: dict[bytes, tuple[_core.CellValues | None, Forecast, int]] = {}
        """State → the leaves that were used, the forecast, and edges followed for it."""

    @property
    def farther(self) -> bool:
        """Whether a first action is safe only if it leaves enough ways on beyond the lookahead.

        Two are enough, each of which holds an action and then another one, without risk up to four
        times the depth; where no action leaves two, those that leave the most are safe. An action
        that leaves fewer has the safe steps of the depth that was expanded, and risk 1.
        """
        return self._core.farther

    @farther.setter
    def farther(self, farther: bool) -> None:
        self._core.farther = farther

    def paths(self) -> Iterator[BestPath]:
        """Yield the best path from each state that the newest forecast expanded.

        They are in the order in which they were found, without those in which the task has ended.
        """
        return map(BestPath._make, self._core.paths())

    @contextlib.contextmanager
    def prefetch(self, states: Sequence[Vector]) -> Iterator[None]:
        """Have the forecasts for these states at hand in the body, computed on all cores.

        Model and leaves are used as they are now. Where searches are short, nothing is done, which
        does not depend on the number of cores.
        """
        if len(states) > 1 and self._most >= _WORTH:
            found = self._core.forecast_batch(np.array(states), self.leaves, _CORES)
            for state, (fields, followed) in zip(states, found, strict=True):
                self._prefetched[state.tobytes()] = self.leaves, forecast_of(fields), followed
        try:
            yield
        finally:
            self._prefetched.clear()

    def forecast(self, state: NDArray[np.float64]) -> Forecast:
        """Return the forecast for one state `[F]`.

        The values are not checked; see `TransitionModel.check_state`.

        Raises:
            StateError: The shape is wrong.
        """
        state = self._checked(state)
        if self._prefetched:
            leaves, forecast, followed = self._prefetched.get(state.tobytes(), (None, None, 0))
            if forecast is not None and leaves is self.leaves:
                self.followed = followed
                return forecast
        fields, self.followed = self._core.forecast(state, self.leaves)
        return forecast_of(fields)

    def _checked(self, state: NDArray[np.float64]) -> NDArray[np.float64]:
        state = np.ascontiguousarray(state, dtype=np.float64)
        if state.shape != (self._width,):
            raise StateError(f"a state has {self._width} numbers, found shape {state.shape}")
        return state

    def check_safety(self, state: Vector) -> Forecast | None:
        """Return which actions are safe in a state `[F]`, without their values.

        Flags and rewards are those of `forecast`, and so is where `safe_steps` is SAFE. Values are
        NaN, and no action is chosen. None where a few edges, depth-first, do not find a path
        without risk by every action that has no risk of its own.
        """
        forecast = forecast_of(self._core.check_safety(self._checked(state))[0])
        return forecast if forecast.bound is Bound.SAFETY else None


_NEAR: Final = 20_000
"""Most edges that the lookahead beside a plan follows; they take some milliseconds."""


def near_lookahead(model: TransitionModel, settings: PlannerSettings) -> Lookahead:
    """Return the lookahead that says, beside a plan, what is unsafe ahead."""
    most = max(1, min(settings.max_nodes, _NEAR // max(1, len(model.actions))))
    return Lookahead(model, settings.replace(max_nodes=most))
