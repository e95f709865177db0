"""The closed planning graph: all states that can be reached, and the best action in each.

Equal states are one node, so that the graph of a finite task is finite, and a plan sees to its end.
The graph is solved by value iteration and kept: while the world stays inside it, a decision is a
look-up.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp import _core
from serp._util.saved_state import Arrays, Saved
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.forecast import Forecast, forecast_of
from serp.planning.inert import inert_fluents
from serp.settings import PlannerSettings

MAX_EDGES: Final = 400_000
"""Most work of a graph, in edges; with this much, expansion and solution take about a second."""


class ClosedGraph(_core.ClosedGraph):
    """A planning graph in which all equal states are one node.

    Args:
        model: The transition model.
        settings: Discount and accepted risk.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings) -> None:
        super().__init__(model.core, settings.discount, settings.accepted_risk)
        self._model = model
        self.clear()

    def clear(self) -> None:
        """Forget all nodes."""
        self.begin(inert_fluents(self._model))

    def grow(self, states: Vector, limit: int = MAX_EDGES) -> None:
        """Add a state `[F]` or several, and what can be reached from them, and solve the graph.

        Where the graph would become too large, some nodes are left unexpanded, those with the most
        actions on the way to them.

        Args:
            states: The states. In an empty graph, all of these are expanded.
            limit: Most work, in edges, see `work`.
        """
        super().grow(np.array(states, ndmin=2), limit)

    def forecast(self, state: Vector) -> Forecast | None:
        """Return the forecast for a state `[F]`.

        Returns:
            None where the state is not in the graph, or its best policy leaves the graph.
        """
        fields = self.look_up(state)
        return None if fields is None else forecast_of(fields)

    def state_dict(self) -> Arrays:
        """Return arrays that `load_state_dict` restores exactly."""
        return self.columns()

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `state_dict` returned, or raise a RunError if it is damaged."""
        self.clear()
        saved = Saved("planning graph", arrays, {})
        columns = {
            name: saved.array(name, column.dtype, (-1,), None)  # compiled code checks the values
            for name, column in self.columns().items()
        }
        try:
            self.restore(columns)
        except ValueError as error:
            raise saved.wrong(str(error)) from None
