"""The planner on arrays: the decisions of the planning graph, without objects."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.planning.far_sight.cell_values import NO_CELLS, CellValues
from serp.planning.forecast import Forecast
from serp.planning.kernel_records import FirstActions, Rules, Scratch
from serp.planning.limits import Bound, edge_budget, lookahead_nodes
from serp.planning.preference import PathScore, path_score
from serp.planning.search_kernels import search
from serp.settings import PlannerSettings

_BOUNDS = tuple(Bound)
_CORES = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
_WORTH = 500
"""Most edges of a search from which on threads save time; so many take about 0.1 ms."""


class Lookahead:
    """Monitor-replanning on arrays, for use in every step of a training.

    Memory is bounded by the budgets of nodes and edges and allocated once. Not thread-safe:
    give each thread its own.

    Args:
        model: The transition model.
        settings: Depth, discount and bounds.

    Attributes:
        leaves: The values of the states that the last layer leads to. Without any they are 0, and
            all decisions are those of the planning graph.
        followed: Edges that the newest forecast followed; before the first one, the most.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings | None = None) -> None:
        self.model = model
        self.settings = settings or PlannerSettings()
        self._address = model.machine_code[0]  # compiled now, so that no decision waits for it
        self.leaves = NO_CELLS
        self._width = len(model.fluents)
        self._actions = len(model.actions)
        nodes = lookahead_nodes(self.settings, self._actions, self._width)
        self._rules = tuple(
            Rules(
                actions=self._actions,
                depth=self.settings.depth,
                repeat=self.settings.repeat,
                discount=self.settings.discount,
                accepted_risk=self.settings.accepted_risk,
                max_nodes=nodes,
                max_edges=edge_budget(self._width),
            )
        )
        self.followed = self._most = nodes * self._actions
        self._memory = Scratch.allocate(nodes, self._actions, self._width)
        self._scratch = tuple(self._memory)
        self._others: list[Lookahead] = []
        self._foreseen: dict[bytes, tuple[CellValues, Forecast, int]] = {}
        """State → the leaves that were used, the forecast, and edges followed for it."""

    def scores(self, count: int) -> Iterator[PathScore]:
        """Yield the score of the best path from each of the first states of the newest forecast.

        They are in the order in which they were found; those in which the task has ended are left
        out.
        """
        found = self._memory
        for risk, steps, value in zip(
            found.best_risk[:count].tolist(), found.best_steps[:count].tolist(),
            found.best_value[:count].tolist(), strict=True,
        ):  # fmt: skip
            yield path_score(0, risk, steps, value)

    @contextlib.contextmanager
    def foreseeing(self, states: Sequence[Vector]) -> Iterator[None]:
        """Have the forecasts for these states at hand in the body, computed on all cores.

        Model and leaves are used as they are now. Where searches are short, nothing is done, which
        does not depend on the number of cores.
        """
        if len(states) > 1 and self._most >= _WORTH:
            self._foresee(states, min(_CORES, len(states)))
        try:
            yield
        finally:
            self._foreseen.clear()

    def _foresee(self, states: Sequence[Vector], threads: int) -> None:
        while len(self._others) < threads:
            self._others.append(Lookahead(self.model, self.settings))

        def forecasts(lookahead: Lookahead, own: Sequence[Vector]) -> None:
            lookahead.leaves = self.leaves
            for state in own:
                found = lookahead.forecast(state)
                self._foreseen[state.tobytes()] = self.leaves, found, lookahead.followed

        with ThreadPoolExecutor(threads) as pool:
            parts = [states[k::threads] for k in range(threads)]
            list(pool.map(forecasts, self._others[:threads], parts))

    def forecast(self, state: NDArray[np.float64]) -> Forecast:
        """Return the forecast for one state `[F]`.

        The values are not checked; see `TransitionModel.check_state`.

        Raises:
            StateError: The shape is wrong.
        """
        state = np.ascontiguousarray(state, dtype=np.float64)
        if state.shape != (self._width,):
            raise StateError(f"a state has {self._width} numbers, found shape {state.shape}")
        if self._foreseen:
            leaves, foreseen, followed = self._foreseen.get(state.tobytes(), (None, None, 0))
            if foreseen is not None and leaves is self.leaves:
                self.followed = followed
                return foreseen
        found = FirstActions.allocate(self._actions)
        choice, depth, bound, self.followed = search(
            (self._address, self.model.data, self.model.dt), self._rules,
            tuple(self.leaves), state, self._scratch, tuple(found),
        )  # fmt: skip
        return Forecast(choice, *found, depth, _BOUNDS[bound])
