"""A planning graph over cells of the state space, for tasks with continuous states.

A cell holds the states whose continuous fluents lie in the same bins and whose other fluents are
equal. States that fall into one cell are one node, so that the graph closes. It says where a task
can be led that is farther than a lookahead sees; a lookahead with these values at its leaves
chooses the action.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp import _core
from serp._util.saved_state import Arrays, Saved
from serp.model.transition_model import UNKNOWN, TransitionModel, Vector
from serp.planning.inert import inert_fluents
from serp.planning.lookahead import edge_budget
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

_COLUMNS: Final = ("low", "scale", "area", "states", "value", "area_value")
"""Values of areas are saved, too: they are those of when the cells were found."""


class CellGraph:
    """A planning graph over cells.

    Args:
        model: The transition model.
        settings: Discount and accepted risk.
        max_edges: Most edges.

    Attributes:
        values: The values of the cells, for `Lookahead.leaves`; None where there are none.
        explores: Whether the plan leads to what is not known.
        bins: Number of bins in the range of a fluent at the next attempt; 0 before the first.
        steps: Steps of the model that the newest build predicted.
        needed: Those of its last attempt.
    """

    def __init__(
        self, model: TransitionModel, settings: PlannerSettings, max_edges: int = MAX_EDGES
    ) -> None:
        self._model, self._discount = model, settings.discount
        fitting = min(max_edges, edge_budget(len(model.fluents)))
        self._max_edges = max(len(model.actions), fitting)
        self._core = _core.CellGraph(settings.discount, settings.accepted_risk, self._max_edges)
        self.values: _core.CellValues | None = None
        self.explores = False
        self.bins = 0.0
        self.steps = self.needed = 0

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
        sample = states[chosen]
        low, high = states.min(axis=0), states.max(axis=0)
        divided = (states != np.round(states)).any(axis=0) & (high > low)
        if not divided.any() or not np.isfinite(sample).all():
            return False
        unit = np.where(divided, 1.0 / np.where(divided, high - low, 1.0), 0.0)
        area = unit * _core.AREAS
        inert = inert_fluents(self._model)
        unit[inert], area[inert] = -1.0, 0.0
        roots = np.vstack((state, sample))

        def expand(bins: float) -> int:
            """Return the steps that were predicted, -1 if these were too many."""
            steps, complete = self._core.expand(
                self._model.core, low, unit * bins, area, roots, limit, UNKNOWN
            )
            self.steps += steps
            return steps if complete else -1

        bins, first = self.bins or COARSEST, not self.bins
        while (used := expand(bins)) < 0:
            if bins <= COARSEST:
                self.bins = 0.0
                return False
            bins, first = max(COARSEST, bins / _FINER), False
        room = min(limit, self._max_edges) / (2.0 * _FINER**2)
        while first and used < room and bins * _FINER <= FINEST:
            used = expand(bins * _FINER)
            if used < 0:
                used = expand(bins)
                break
            bins *= _FINER
        self._solve()
        self.needed = used
        self.bins = bins * _FINER if used < room and bins * _FINER <= FINEST else bins
        return True

    def _solve(self) -> None:
        """Solve the graph for what is known, and if that has nothing to offer, for the frontier."""
        graph = self._core
        if not graph.edges:
            return
        rates, actions = graph.lasting_rates()
        least, middle, most, alike = 0.0, 0.0, 0.0, True
        if rates.size:
            least, middle, most = np.quantile(rates, (0.0, 0.5, 1.0)).tolist()
            alike = _depend_on_actions_alone(rates, actions)
        ages = 1.0 / max(1.0 - self._discount, 1e-6)
        going_on = most * ages
        worst, hoped = min(0.0, least * ages), max(0.0, going_on)
        if most == 0.0:  # to wait costs nothing
            hoped = -_HOPE * worst if worst < 0.0 else 1.0
        graph.begin(None if self.explores else self.values, middle * ages)
        value = graph.solve(worst, worst)
        margin = 1e-3 * (hoped - worst)
        self.explores = bool(alike and hoped > going_on and value <= going_on + margin)
        if self.explores:
            graph.solve(worst, hoped)
        self.values = graph.values(hoped if self.explores else worst)

    def state_dict(self) -> tuple[Arrays, dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        values = self.values
        arrays = dict.fromkeys(_COLUMNS, np.zeros(0)) if values is None else values.columns()
        return arrays, {"bins": self.bins, "explores": self.explores}

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned, or raise a RunError if it is damaged."""
        saved = Saved("values of cells", arrays, meta)
        columns = {name: saved.array(name, np.float64, (-1,)) for name in _COLUMNS}
        bins, explores = saved.real("bins", 0.0, FINEST), saved.truth("explores")
        if 0.0 < bins < COARSEST:
            raise saved.wrong(f"bins is {bins}")
        values, width = None, len(self._model.fluents)
        if any(column.size for column in columns.values()):
            if len(columns["low"]) != width:
                raise saved.wrong(f"low has {len(columns['low'])} numbers for {width} fluents")
            try:
                values = _core.CellValues(**columns)
            except ValueError as error:
                raise saved.wrong(str(error)) from None
        self.values, self.bins, self.explores = values, bins, explores


def _depend_on_actions_alone(rates: Vector, action: NDArray[np.int32]) -> bool:
    """Return whether no state gives more than others do after the same action."""
    for one in np.unique(action):
        middle, most = np.quantile(rates[action == one], (0.5, 1.0))
        if most - middle > 1e-6 * max(abs(most), abs(middle)):
            return False
    return True
