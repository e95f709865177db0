"""Monitor-replanning (MrP): monitor, expand, choose the best path, execute its first action.

Paper, section 3.2, after Russell & Norvig's execution monitoring and replanning.
"""

from __future__ import annotations

import functools
import math
import time
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import networkx as nx
import numpy as np
from numpy.typing import ArrayLike

from serp._util.numbers import real
from serp.errors import SettingsError
from serp.model.flags import UNSAFE, risk_of
from serp.model.transition_model import TransitionModel
from serp.planning.forecast import Forecast
from serp.planning.graph import PlanningGraph
from serp.planning.limits import Bound
from serp.settings import PlannerSettings

_SETTINGS: Final = ("depth", "discount", "repeat", "max_nodes", "accepted_risk")


class PlannedStep(NamedTuple):
    """One edge of the chosen path: action (name), predicted reward, flag, risk, state reached."""

    action: str
    reward: float
    unsafe: bool
    risk: float
    state: tuple[float, ...]


@dataclass(frozen=True)
class Plan:
    """One decision of the planner.

    Attributes:
        action: Position of the chosen action, or None where none is applicable.
        name: Its name, or None.
        path: The chosen path.
        reward: Discounted sum of rewards along it.
        safe: Whether every risk on it is accepted.
        indifferent: Whether all safe actions have the same score: no difference is visible within
            the lookahead, and the first action in the file was chosen.
        depth: Layers that were expanded.
        bound: What ended the expansion: depth, nodes, time, or nothing left to expand.
        forecast: The prediction for every first action.
        planning_graph: The planning graph of the lookahead.
    """

    action: int | None
    name: str | None
    path: tuple[PlannedStep, ...]
    reward: float
    safe: bool
    indifferent: bool
    depth: int
    bound: Bound
    forecast: Forecast
    planning_graph: PlanningGraph = field(repr=False)

    @classmethod
    def of(
        cls,
        model: TransitionModel,
        forecast: Forecast,
        path: tuple[PlannedStep, ...],
        graph: PlanningGraph,
    ) -> Plan:
        """Return the decision that a forecast for the root of a planning graph makes."""
        chosen = forecast.choice if forecast.choice >= 0 else None
        return cls(
            action=chosen,
            name=None if chosen is None else model.actions[chosen].name,
            path=path,
            reward=0.0 if chosen is None else float(forecast.value[chosen]),
            safe=forecast.safe,
            indifferent=forecast.indifferent,
            depth=forecast.depth,
            bound=forecast.bound,
            forecast=forecast,
            planning_graph=graph,
        )

    @property
    def nodes(self) -> int:
        """Number of states in the planning graph."""
        return len(self.planning_graph.states)

    @property
    def paths(self) -> list[list[int]]:
        """The actions of the best path in the graph that begins with each action.

        Each is for one control period.
        """
        graph = self.planning_graph
        repeat = graph.settings.repeat
        return [
            [edge.action for edge in graph.path_by(k) for _ in range(repeat)]
            for k in range(len(self.forecast.flags))
        ]

    @functools.cached_property
    def graph(self) -> nx.MultiDiGraph:
        """The planning graph; see `PlanningGraph.to_networkx`."""
        return self.planning_graph.to_networkx()


class MonitorReplanner:
    """The planner of the paper, with its planning graph.

    A decision is a pure function of state and model, except under `time_budget`.

    Args:
        model: The transition model.
        depth, discount, repeat, max_nodes, accepted_risk: See `PlannerSettings`.
        time_budget: Seconds a decision may take; the deepest layer completed by then counts.
            None for no bound.

    Raises:
        SettingsError: A setting is outside its range.
    """

    def __init__(
        self,
        model: TransitionModel,
        *,
        depth: int = 5,
        discount: float = 0.99,
        repeat: int = 1,
        max_nodes: int = 10_000,
        accepted_risk: float = 0.02,
        time_budget: float | None = None,
    ) -> None:
        if not isinstance(model, TransitionModel):
            raise SettingsError(
                f"planner: model must be a TransitionModel such as `domain.model`, not {model!r}"
            )
        self.model = model
        self.settings = PlannerSettings(
            depth=depth, discount=discount, repeat=repeat, max_nodes=max_nodes,
            accepted_risk=accepted_risk,
        )  # fmt: skip
        self.time_budget = None if time_budget is None else real(time_budget, infinite=True)
        if time_budget is not None and not (self.time_budget or 0.0) > 0:
            raise SettingsError(f"planner: time_budget must be positive, not {time_budget!r}")
        # Compiled and loaded now: it would count as time of the first decision.
        model.native_step()
        PlanningGraph(
            model, self.settings.replace(depth=1, max_nodes=1), np.zeros(len(model.fluents))
        )

    @classmethod
    def of(
        cls, model: TransitionModel, settings: PlannerSettings, *, time_budget: float | None = None
    ) -> MonitorReplanner:
        """Return the planner with settings; its graph is the same whatever planner they name."""
        return MonitorReplanner(model, **cls.used(settings), time_budget=time_budget)

    @staticmethod
    def used(settings: PlannerSettings) -> dict[str, Any]:
        """Return those of the settings that count here, by name."""
        return {name: getattr(settings, name) for name in _SETTINGS}

    def plan(self, state: ArrayLike) -> Plan:
        """Plan from an observed state `[F]`.

        Raises:
            StateError: The state does not fit the model.
        """
        start = time.perf_counter()
        deadline = math.inf if self.time_budget is None else start + self.time_budget
        graph = PlanningGraph(self.model, self.settings, self.model.check_state(state), deadline)
        names = [action.name for action in self.model.actions]
        path = tuple(
            PlannedStep(
                names[e.action],
                e.reward,
                bool(e.flags & UNSAFE),
                risk_of(e.flags),
                graph.states[e.target],
            )
            for e in graph.best_path
        )
        return Plan.of(self.model, graph.forecast, path, graph)
