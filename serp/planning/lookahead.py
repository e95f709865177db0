"""The planner in array form: the decisions of the planning graph, without objects."""

from __future__ import annotations

import threading
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from serp.model.native import address_of
from serp.model.transition_model import StateError, TransitionModel
from serp.planning import search_kernels as kernels
from serp.planning.forecast import Forecast
from serp.planning.limits import Bound, edge_budget, node_budget
from serp.planning.records import Rules, Scratch, room_for_actions
from serp.settings import PlannerSettings

_BOUNDS = tuple(Bound)
# numba's own thread pool aborts the process where two threads enter it at once.
_POOL = threading.Lock()


class BatchForecast(NamedTuple):
    """`Forecast` of every row of a batch; each field has a leading axis `[B]`."""

    choice: NDArray[np.int64]
    value: NDArray[np.float64]
    path_risk: NDArray[np.float64]
    safe_steps: NDArray[np.int64]
    reward: NDArray[np.float64]
    flags: NDArray[np.int64]
    depth: NDArray[np.int64]
    bound: NDArray[np.int64]


class Lookahead:
    """Monitor-replanning without the graph: what training calls in every step.

    Memory is bounded by the budgets of `PlannerSettings` and allocated once (once a thread for
    batches). Not thread-safe: give each thread its own.

    Args:
        model: The transition model.
        settings: Depth, discount and bounds.

    Attributes:
        leaves: What the states are worth that the last layer leads to (`LeafValue.packed`), where
            the settings' `leaf_value` asks for it; empty: nothing, so that all decisions are those
            of the planning graph.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings | None = None) -> None:
        self.model = model
        self.settings = settings or PlannerSettings()
        self._callback = model.native_step()
        self._address = address_of(self._callback)
        self.leaves: NDArray[np.float64] = np.zeros(0)
        self._never = self.settings.leaf_value == "never"
        self._width = len(model.fluents)
        self._actions = len(model.actions)
        self._edge_budget = edge_budget(self._width)
        self._nodes = self._most_nodes()
        self._rules = tuple(
            Rules(
                actions=self._actions,
                depth=self.settings.depth,
                repeat=self.settings.repeat,
                discount=self.settings.discount,
                accepted_risk=self.settings.accepted_risk,
                max_nodes=self._nodes,
                max_edges=self._edge_budget,
                always=self.settings.leaf_value == "always",
            )
        )
        self._scratch = tuple(array[0] for array in self._allocate(1))
        self._batch_scratch: tuple[NDArray[Any], ...] = ()

    def _most_nodes(self) -> int:
        """Most nodes that can ever be expanded: the budget, or the whole tree if it is smaller.

        Every node but the root has an edge that leads to it.
        """
        budget = min(node_budget(self.settings.max_nodes, self._actions), self._edge_budget + 1)
        tree, layer = 0, 1
        for _ in range(self.settings.depth):
            tree += layer
            layer *= max(1, self._actions)
            if tree >= budget:
                return budget
        return tree

    def _allocate(self, threads: int) -> tuple[NDArray[Any], ...]:
        return tuple(Scratch.allocate(self._nodes, self._actions, self._width, threads))

    def _searched(self) -> tuple[tuple[Any, ...], tuple[Any, ...], NDArray[np.float64]]:
        """Return the first arguments of both searches: model, rules and leaves."""
        model = (self._address, self.model.data, self.model.dt)
        return model, self._rules, self.leaves[:0] if self._never else self.leaves

    def forecast(self, state: NDArray[np.float64]) -> Forecast:
        """Return the planner's view of one state `[F]`.

        The values are not looked at; see `TransitionModel.check_state`.

        Raises:
            StateError: The shape is wrong.
        """
        state = np.ascontiguousarray(state, dtype=np.float64)
        if state.shape != (self._width,):
            raise StateError(f"a state is {self._width} numbers, found shape {state.shape}")
        found = room_for_actions(self._actions)
        choice, depth, bound = kernels.search(*self._searched(), state, self._scratch, found)
        return Forecast(choice, *found, depth, _BOUNDS[bound])

    def forecast_batch(self, states: ArrayLike) -> BatchForecast:
        """Return the planner's view of every row of `[B, F]`, computed in parallel.

        Raises:
            StateError: The shape is wrong.
        """
        batch = np.ascontiguousarray(states, dtype=np.float64)
        if batch.ndim != 2 or batch.shape[1] != self._width:
            raise StateError(f"states are rows of {self._width} numbers, found shape {batch.shape}")
        rows = batch.shape[0]
        threads = kernels.threads()
        if not self._batch_scratch or len(self._batch_scratch[0]) < threads:
            self._batch_scratch = self._allocate(threads)
        found = room_for_actions(rows, self._actions)
        choice, depth, bound = (np.empty(rows, dtype=np.int64) for _ in range(3))
        with _POOL:
            kernels.search_batch(
                *self._searched(), batch, self._batch_scratch, found, choice, depth, bound
            )
        return BatchForecast(choice, *found, depth, bound)
