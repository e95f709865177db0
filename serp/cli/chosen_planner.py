"""A planner by its name, for `serp plan`."""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING

import numpy as np

from serp._util.number_format import readable
from serp._util.text import plural
from serp.explanation.sentences import TO_THE_UNKNOWN
from serp.planning.limits import Bound
from serp.planning.lookahead import Lookahead
from serp.planning.plan_follower import PlanFollower
from serp.planning.replanner import MonitorReplanner, Plan, PlannedStep

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from serp.control.protocols import Planner
    from serp.model.transition_model import TransitionModel, Vector
    from serp.settings import PlannerSettings


class ChosenPlanner(MonitorReplanner):
    """Any planner, in the form that `serp plan` shows.

    Values and choices are the planner's own. The path of the lookahead is the one that it values;
    that of another planner is where its choices lead to by the model, a control period a step. The
    graph is that of the lookahead alone.

    Args:
        planner: The planner.
        model: The model that it plans with.
        settings: Its settings.
        time_budget: Seconds that the lookahead may take.
        called: What it is called in messages.
        undisturbed: Makes a context at whose end the planner is as it was before.
    """

    def __init__(
        self,
        planner: Planner,
        model: TransitionModel,
        settings: PlannerSettings,
        time_budget: float,
        called: str,
        undisturbed: Callable[[], contextlib.AbstractContextManager[None]] = contextlib.nullcontext,
    ) -> None:
        super().__init__(model, **self.used(settings), time_budget=time_budget)
        self._planner = planner
        self._called = called
        self._undisturbed = undisturbed

    def lookahead(self, state: ArrayLike) -> Plan:
        """Plan by the lookahead alone."""
        return super().plan(state)

    def plan(self, state: ArrayLike) -> Plan:
        """Plan from an observed state `[F]`; the planner is then as it was before."""
        now = self.model.check_state(state)
        near = self.lookahead(now)
        if isinstance(self._planner, Lookahead):
            return near
        with self._undisturbed():
            found = self._planner.forecast(now)
            path = self._path(now, found.choice)
            return Plan.of(self.model, found, path, near.planning_graph)

    def paths(self, plan: Plan, state: Vector) -> list[list[int]]:
        """Return where each action leads to, a control period a step, as far as there is time.

        Of the lookahead, these are the paths that it values.

        Of a planner that searches for whole plans, this is the plan alone.
        """
        if isinstance(self._planner, Lookahead):
            return plan.paths
        number, deadline = self.model.action_index, time.monotonic() + (self.time_budget or 0.0)
        found: list[list[int]] = [[] for _ in self.model.actions]
        if plan.action is not None:
            found[plan.action] = [number(step.action) for step in plan.path]
        if isinstance(self._planner, PlanFollower):
            return found
        with self._undisturbed():
            for k in np.flatnonzero(plan.forecast.applicable).tolist():
                if k != plan.action and time.monotonic() < deadline:
                    found[k] = [number(step.action) for step in self._path(state, k)]
        return found

    def _path(self, state: Vector, choice: int) -> tuple[PlannedStep, ...]:
        path: list[PlannedStep] = []
        followed = len(self._planner.plan) if isinstance(self._planner, PlanFollower) else 0
        while choice >= 0 and len(path) < (followed or self.settings.depth):
            step = self.model.step(state, choice)
            state, name = step.state, self.model.actions[choice].name
            end = tuple(state.tolist())
            path.append(PlannedStep(name, step.reward, step.unsafe, step.risk, end))
            if step.terminal:
                break
            choice = self._planner.forecast(state).choice
        return tuple(path)

    def sight(self, plan: Plan) -> str:
        """Say how far the planner saw."""
        discount = f"discount {readable(self.settings.discount)}"
        if isinstance(self._planner, PlanFollower) and self._planner.plan:
            length = plural(len(self._planner.plan), "action")
            return f"{self._called} follows a plan of {length} to the goal."
        if plan.bound is Bound.EXHAUSTED:
            return f"{self._called} saw everything that can be reached, {discount}."
        repeat = self.settings.repeat if isinstance(self._planner, Lookahead) else 1
        each = f", each repeated for {repeat} control periods" if repeat > 1 else ""
        saw = f"{self._called} looked ahead {plural(plan.depth, 'action')}{each}, {discount}."
        if plan.bound is Bound.CELLS:
            saw += " Values of cells stand for what lies beyond."
        elif plan.bound is Bound.UNKNOWN:
            saw += f" {TO_THE_UNKNOWN}"
        elif plan.bound is not Bound.DEPTH:
            saw += " Its budget ended there."
        return saw
