"""A planning graph over cells of the state space, for tasks with continuous states.

States that fall into one cell are one node, so that the graph closes. It says where a task can be
led that is farther than a lookahead sees; a lookahead with these values at its leaves chooses the
action.
"""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from serp.model.native import OUTCOMES, address_of
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.far_sight import cell_kernels as kernels
from serp.planning.far_sight.array_graph import DONE, ENDED, ArrayGraph, GraphArrays
from serp.planning.far_sight.cell_kernels import CellArrays
from serp.planning.far_sight.cell_solution import begin_values, solve_cells
from serp.planning.far_sight.cell_values import AREAS, NO_CELLS, Cells, CellValues, set_value
from serp.planning.far_sight.inert import inert_fluents
from serp.settings import PlannerSettings

_HOPE: Final = 10.0
"""Where waiting is free, the unknown is worth so many times what it costs to act for ever; a
step of delay costs so many times what a step costs."""
MAX_EDGES: Final = 60_000
"""Most edges of a graph of cells."""
_SAMPLE: Final = 500
"""Visited states that the graph begins with."""
_LEAST: Final = 32
"""Fewer visited states say too little about the ranges of fluents."""
FINEST: Final = 100.0
COARSEST: Final = 4.0
_FINER: Final = 1.4
"""Bins in the range of a fluent: most, least, and the ratio from one attempt to the next."""


class Visited(Protocol):
    """The states that were visited; `serp.sysid.transitions.TransitionMemory` is one.

    Attributes:
        seen: How many transitions were added.
    """

    seen: int

    @property
    def next_states(self) -> Vector:
        """`[N, F]`, the oldest first."""


class CellGraph(ArrayGraph):
    """A planning graph over cells.

    Args:
        model: The transition model.
        settings: Discount and accepted risk.
        max_edges: Most edges.

    Attributes:
        values: The values of the cells, for `Lookahead.leaves`.
        explores: Whether the plan leads to what is not known.
        bins: Number of bins in the range of a fluent at the next attempt; 0 before the first.
        steps: Steps of the model that the newest build predicted.
        needed: Those of its last attempt.
    """

    def __init__(
        self, model: TransitionModel, settings: PlannerSettings, max_edges: int = MAX_EDGES
    ) -> None:
        super().__init__(model, settings)
        self._edges = max(self._actions, max_edges)
        self._room = np.empty(2 * (self._width + 1))
        self._allocate(self._actions)
        self.values = NO_CELLS
        self.explores = False
        self.bins = 0.0
        self.steps = self.needed = 0
        if self._width and self._actions:
            self._precompile()

    def _precompile(self) -> None:
        """Call every compiled loop once, so that no decision waits for a compilation."""
        zeros = np.zeros(self._width)
        cells = Cells(zeros, zeros, zeros)
        self._expand(zeros, cells, 1)
        self._solve(cells)
        set_value(self.values, zeros, 0.0)
        self.values, self.explores, self.steps = NO_CELLS, False, 0

    def build(self, state: Vector, states: Vector, limit: int) -> bool:
        """Build the graph for a state `[F]` and visited states `[N, F]`.

        The division is as fine as `limit`, the steps of the model to predict, allows. It is
        approached from build to build, so that most builds expand the graph once.

        Returns:
            Whether there is one: some fluent is continuous, and cells fit into the limit. If not,
            the former values are kept.
        """
        self.steps = 0
        if len(states) < _LEAST:
            return False
        chosen = np.linspace(0, len(states) - 1, min(len(states), _SAMPLE)).astype(np.intp)
        sample = np.ascontiguousarray(states[chosen])
        low, high = states.min(axis=0), states.max(axis=0)
        divided = (states != np.round(states)).any(axis=0) & (high > low)
        if not divided.any() or not np.isfinite(sample).all():
            return False
        unit = np.where(divided, 1.0 / np.where(divided, high - low, 1.0), 0.0)
        area = unit * AREAS
        if self._model.as_written:
            inert = inert_fluents(self._model.ground)
            unit[inert], area[inert] = -1.0, 0.0
        if len(self._arrays.action) < self._edges:
            self._allocate(self._edges)

        roots = np.concatenate((state, sample.ravel()))

        def divided_into(bins: float) -> Cells:
            return Cells(low, unit * bins, area)

        bins, first = self.bins or COARSEST, not self.bins
        while (used := self._expand(roots, divided_into(bins), limit)) < 0:
            if bins <= COARSEST:
                self.bins = 0.0
                return False
            bins, first = max(COARSEST, bins / _FINER), False
        room = min(limit, self._edges) / (2.0 * _FINER**2)
        while first and used < room and bins * _FINER <= FINEST:
            used = self._expand(roots, divided_into(bins * _FINER), limit)
            if used < 0:
                used = self._expand(roots, divided_into(bins), limit)
                break
            bins *= _FINER
        self._solve(divided_into(bins))
        self.needed = used
        self.bins = bins * _FINER if used < room and bins * _FINER <= FINEST else bins
        return True

    def _expand(self, roots: Vector, cells: Cells, limit: int) -> int:
        """Expand the graph; return the steps that were predicted, -1 if these were too many."""
        arrays, division, doubts = self._arrays, tuple(cells), self._model.native_uncertainty()
        arrays.counters[:] = 0
        arrays.table[:] = -1
        kernels.add_roots(self._arrays_tuple, division, self._held, roots)
        ended, steps = kernels.expand_cells(
            (self._model.machine_code, np.intp(0) if doubts is None else address_of(doubts)),
            (self._actions, self._settings.discount, self._settings.accepted_risk, limit),
            self._arrays_tuple, division, self._held, self._room,
        )  # fmt: skip
        self.steps += steps
        return int(steps) if ended == DONE else -1

    def _solve(self, cells: Cells) -> None:
        """Solve the graph for what is known, and if that has nothing to offer, for the frontier."""
        kernels.interpolate(self._arrays_tuple, tuple(cells), self._held)
        arrays, held, discount = self._arrays, self._edges_held, self._settings.discount
        edges, nodes = self.edges, self.nodes
        if not edges:
            return
        rates = held.reward[:edges] / held.periods[:edges]
        # The reward of an end, or of what is unsafe, is not one that goes on.
        goes_on = (held.node[:edges] != ENDED) | (held.beyond[:edges] > 0.0)
        goes_on &= arrays.hazard[:edges] == 0.0
        least, middle, most, alike = 0.0, 0.0, 0.0, True
        if goes_on.any():
            least, middle, most = np.quantile(rates[goes_on], (0.0, 0.5, 1.0)).tolist()
            alike = _depend_on_actions_alone(rates[goes_on], arrays.action[:edges][goes_on])
        ages = 1.0 / max(1.0 - discount, 1e-6)
        going_on = most * ages
        worst, hoped = min(0.0, least * ages), max(0.0, going_on)
        if most == 0.0:  # to wait costs nothing
            hoped = -_HOPE * worst if worst < 0.0 else 1.0
        former = NO_CELLS if self.explores else self.values
        begin_values(self._arrays_tuple, self._width, tuple(former), middle * ages)
        solve_cells(self._arrays_tuple, self._held, discount, worst, worst)
        margin = 1e-3 * (hoped - worst)
        self.explores = bool(alike and hoped > going_on and arrays.value[0] <= going_on + margin)
        if self.explores:
            solve_cells(self._arrays_tuple, self._held, discount, worst, hoped)
        elsewhere = hoped if self.explores else worst
        self.values = CellValues.of(
            cells.low, cells.scale, cells.area,
            arrays.states[: nodes * self._width].copy(), np.append(arrays.value[:nodes], elsewhere),
        )  # fmt: skip

    def _allocate(self, edges: int) -> None:
        nodes = edges // max(1, self._actions) + self._actions
        edges += self._actions
        self._hold(GraphArrays.allocate(nodes, edges, edges * OUTCOMES, self._width))
        self._edges_held = CellArrays.allocate(nodes, edges, self._width)
        self._held = tuple(self._edges_held)


def _depend_on_actions_alone(rates: Vector, action: NDArray[np.int64]) -> bool:
    """Return whether no state gives more than others do after the same action."""
    for one in np.unique(action):
        middle, most = np.quantile(rates[action == one], (0.5, 1.0))
        if most - middle > 1e-6 * max(abs(most), abs(middle)):
            return False
    return True
