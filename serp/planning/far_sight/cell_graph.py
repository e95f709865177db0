"""A closed planning graph over cells of the state space, for tasks with continuous states.

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
from serp.planning.far_sight import solution_kernels as solution
from serp.planning.far_sight.cell_kernels import HeldEdges
from serp.planning.far_sight.cell_values import Cells, pack
from serp.planning.far_sight.closed_kernels import DONE, Counters, GraphArrays
from serp.settings import PlannerSettings

MAX_EDGES: Final = 60_000
"""Most edges of a graph of cells."""
_SAMPLE: Final = 500
"""Visited states that the graph begins with, and that tell what is known."""
REACH: Final = 0.25
"""A state is known if no fluent differs from that of a visited state by more than this fraction of
its range."""
_LEAST: Final = 32
"""Fewer visited states say too little about the ranges of fluents."""
_FINEST, _COARSEST, _FINER = 100.0, 4.0, 1.4
"""Bins in the range of a fluent: most, least, and the ratio from one attempt to the next."""
_PRECISION: Final = 1e-4
"""Precision of the values, see `serp.planning.far_sight.solution_kernels.EXACT`."""
_SWEEPS: Final = 200
_AT = Counters()


class Visited(Protocol):
    """The states that were visited; `serp.sysid.transitions.TransitionMemory` is one.

    Attributes:
        seen: How many transitions were added.
    """

    seen: int

    @property
    def next_states(self) -> Vector:
        """`[N, F]`, the oldest first."""


class CellGraph:
    """A planning graph over cells.

    Args:
        model: The transition model.
        settings: Discount and accepted risk.
        max_edges: Most edges.

    Attributes:
        values: The values of the cells, for `Lookahead.leaves`; empty if there is no graph.
        explores: Whether the plan leads to what is not known.
        bins: Number of bins in the range of a fluent.
    """

    def __init__(
        self, model: TransitionModel, settings: PlannerSettings, max_edges: int = MAX_EDGES
    ) -> None:
        self._model = model
        self._settings = settings
        self._width = len(model.fluents)
        self._actions = len(model.actions)
        self._edges = max(self._actions, max_edges)
        self._nodes = self._edges // max(1, self._actions)
        self._room = np.empty(2 * (self._width + 1))
        self._allocated = False
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.values: Vector = np.zeros(0)
        self.explores = False
        self.bins = 0.0

    def build(self, state: Vector, states: Vector) -> bool:
        """Build the graph for a state `[F]` and visited states `[N, F]`.

        Returns:
            Whether there is one: some fluent is continuous, and cells fit into the memory.
        """
        self.values = np.zeros(0)
        if len(states) < _LEAST:
            return False
        chosen = np.linspace(0, len(states) - 1, min(len(states), _SAMPLE)).astype(np.intp)
        sample = np.ascontiguousarray(states[chosen])
        low, high = states.min(axis=0), states.max(axis=0)
        divided = (states != np.round(states)).any(axis=0) & (high > low)
        if not divided.any() or not np.isfinite(sample).all():
            return False
        unit = np.where(divided, 1.0 / np.where(divided, high - low, 1.0), 0.0)
        self._allocate()

        def divided_into(bins: float) -> Cells:
            return Cells(low, unit * bins, unit, sample.ravel(), REACH)

        bins = self.bins or _COARSEST
        fits = self._expand(state, divided_into(bins))
        while not fits and bins > _COARSEST:
            bins = max(_COARSEST, bins / _FINER)
            fits = self._expand(state, divided_into(bins))
        if not fits:
            self.bins = 0.0
            return False
        while bins * _FINER <= _FINEST and self.edges < self._edges / (2.0 * _FINER**2):
            if not self._expand(state, divided_into(bins * _FINER)):
                self._expand(state, divided_into(bins))
                break
            bins *= _FINER
        self.bins = bins
        self._solve(divided_into(bins))
        return True

    @property
    def edges(self) -> int:
        """Number of edges."""
        return int(self._arrays.counters[_AT.edges])

    @property
    def nodes(self) -> int:
        """Number of cells."""
        return int(self._arrays.counters[_AT.nodes])

    def _expand(self, state: Vector, cells: Cells) -> bool:
        arrays, division = self._arrays, tuple(cells)
        arrays.counters[:] = 0
        arrays.table[:] = -1
        model = self._model
        kernels.add_roots(self._arrays_tuple, division, np.concatenate((state, cells.visited)))
        ended = kernels.expand_cells(
            (address_of(model.native_step()), model.data, model.dt),
            (self._actions, self._settings.discount, self._settings.accepted_risk),
            self._arrays_tuple, division, self._held, self._room,
        )  # fmt: skip
        return bool(ended == DONE)

    def _solve(self, cells: Cells) -> None:
        """Solve the graph for what is known, and if that has nothing to offer, for the frontier."""
        kernels.interpolate(self._arrays_tuple, tuple(cells), self._held)
        arrays, edges, discount = self._arrays, self.edges, self._settings.discount
        rates = self._edges_held.reward[:edges] / self._edges_held.periods[:edges]
        most, least, middle = rates.max(), rates.min(), np.median(rates)
        ages = 1.0 / max(1.0 - discount, 1e-6)
        going_on = most * ages
        worst, hoped = min(0.0, least * ages), max(0.0, going_on)
        alike = most - middle <= 1e-6 * max(abs(most), abs(middle))
        if most == least == 0.0:
            hoped = 1.0
        arrays.value[: self.nodes] = worst
        self._iterate(worst)
        margin = 1e-3 * (hoped - worst)
        self.explores = bool(alike and hoped > going_on and arrays.value[0] <= going_on + margin)
        if self.explores:
            self._iterate(hoped)
        nodes = self.nodes
        elsewhere = hoped if self.explores else worst
        self.values = pack(
            tuple(cells), arrays.digest[:nodes], arrays.states, arrays.value[:nodes], elsewhere
        )

    def _iterate(self, beyond: float) -> None:
        arrays, edges = self._arrays, self.edges
        arrays.reward[:edges] = (
            self._edges_held.reward[:edges] + beyond * self._edges_held.beyond[:edges]
        )
        solution.solve(
            self._arrays_tuple, self._settings.discount, _PRECISION, _SWEEPS, self._allowed
        )

    def _allocate(self) -> None:
        if self._allocated:
            return
        self._allocated = True
        edges = self._edges + self._actions
        self._arrays = GraphArrays.allocate(
            self._nodes + self._actions, edges, edges * OUTCOMES, self._width
        )
        self._arrays_tuple = tuple(self._arrays)
        self._edges_held = HeldEdges(
            reward=np.zeros(edges),
            periods=np.zeros(edges),
            weight=np.zeros(edges),
            beyond=np.zeros(edges),
            target=np.zeros(edges * self._width),
            node=np.zeros(edges, dtype=np.int64),
        )
        self._held = tuple(self._edges_held)
        self._allowed: NDArray[np.uint8] = np.empty(edges, dtype=np.uint8)
