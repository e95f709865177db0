"""The planner in array form: the decisions of the planning graph, without objects."""

from __future__ import annotations

import threading
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from serp.model.native import address_of
from serp.model.transition_model import StateError, TransitionModel
from serp.planning import kernels
from serp.planning.forecast import Forecast
from serp.planning.limits import Bound, edge_budget, node_budget
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
        self._always = self.settings.leaf_value == "always"
        self._width = len(model.fluents)
        self._actions = len(model.actions)
        self._edge_budget = edge_budget(self._width)
        self._budget = self._nodes()
        self._scratch = tuple(a[0] for a in self._allocate(1))
        self._batch_scratch: tuple[NDArray[np.generic], ...] | None = None

    def _nodes(self) -> int:
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

    def _allocate(self, threads: int) -> tuple[NDArray[np.generic], ...]:
        nodes, edges = self._budget, self._budget * self._actions
        size = 2
        while size < 2 * nodes:
            size *= 2
        return (
            np.zeros((threads, (nodes + 2) * (self._width + 1))),
            np.zeros((threads, edges)),
            np.zeros((threads, edges)),
            np.zeros((threads, edges), dtype=np.uint8),
            np.zeros((threads, edges), dtype=np.int32),
            np.zeros((threads, edges)),
            np.zeros((threads, edges), dtype=np.int32),
            np.zeros((threads, nodes)),
            np.zeros((threads, nodes)),
            np.zeros((threads, nodes), dtype=np.int64),
            np.zeros((threads, size), dtype=np.int32),
        )

    def _used_leaves(self) -> NDArray[np.float64]:
        return self.leaves[:0] if self._never else self.leaves

    def forecast(self, state: NDArray[np.float64]) -> Forecast:
        """Return the planner's view of one state `[F]`.

        The values are not looked at; see `TransitionModel.check_state`.

        Raises:
            StateError: The shape is wrong.
        """
        actions = self._actions
        state = np.ascontiguousarray(state, dtype=np.float64)
        if state.shape != (self._width,):
            raise StateError(f"a state is {self._width} numbers, found shape {state.shape}")
        value, risk, reward = np.empty(actions), np.empty(actions), np.empty(actions)
        steps, flags = np.empty(actions, dtype=np.int64), np.empty(actions, dtype=np.int64)
        settings = self.settings
        choice, depth, bound = kernels.search(
            self._address, state, self._width, actions, settings.depth, settings.repeat,
            settings.discount, settings.accepted_risk, self._budget, self._edge_budget,
            self.model.data, self.model.dt, self._used_leaves(), self._always, *self._scratch,
            value, risk, steps, reward, flags,
        )  # fmt: skip
        return Forecast(choice, value, risk, steps, reward, flags, depth, _BOUNDS[bound])

    def forecast_batch(self, states: ArrayLike) -> BatchForecast:
        """Return the planner's view of every row of `[B, F]`, computed in parallel.

        Raises:
            StateError: The shape is wrong.
        """
        batch = np.ascontiguousarray(states, dtype=np.float64)
        if batch.ndim != 2 or batch.shape[1] != self._width:
            raise StateError(f"states are rows of {self._width} numbers, found shape {batch.shape}")
        rows, actions = batch.shape[0], self._actions
        if self._batch_scratch is None or len(self._batch_scratch[0]) < kernels.threads():
            self._batch_scratch = self._allocate(kernels.threads())
        result = BatchForecast(
            choice=np.empty(rows, dtype=np.int64),
            value=np.empty((rows, actions)),
            path_risk=np.empty((rows, actions)),
            safe_steps=np.empty((rows, actions), dtype=np.int64),
            reward=np.empty((rows, actions)),
            flags=np.empty((rows, actions), dtype=np.int64),
            depth=np.empty(rows, dtype=np.int64),
            bound=np.empty(rows, dtype=np.int64),
        )
        settings = self.settings
        with _POOL:
            kernels.search_batch(
                self._address, batch, actions, settings.depth, settings.repeat, settings.discount,
                settings.accepted_risk, self._budget, self._edge_budget, self.model.data,
                self.model.dt, self._used_leaves(), self._always, *self._batch_scratch, *result,
            )  # fmt: skip
        return result
