"""A planner as it is shown: its plan, what lies behind it, and what would change its choice."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Collection, Iterator

import numpy as np

from serp._util.text import plural, readable
from serp.agent.counterfactuals import Counterfactuals, counterfactuals
from serp.agent.explanation import Explanation, explain
from serp.agent.protocols import Planner
from serp.agent.registry import make_planner, refuse_unknown_names
from serp.agent.sentences import TO_THE_UNKNOWN
from serp.model.transition_model import Outcome, TransitionModel, Vector
from serp.planning.forecast import Bound, Forecast
from serp.planning.plan_follower import PlanFollower
from serp.planning.replanner import MonitorReplanner, Plan, PlannedStep
from serp.settings import PlannerSettings, Settings
from serp.tasks.task import Task


class ChosenPlanner:
    """Any planner, in the form that `serp plan` and `serp why` show.

    Values and choices are the planner's own. Where they are those of the lookahead, the plan is its
    plan: path and planning graph are what it values. The path of another decision is where choices
    lead to by the model, a control period a step, and the graph is that of the lookahead alone.

    Args:
        planner: The planner.
        model: The model that it plans with.
        settings: Its settings.
        name: Its name in messages.
        undisturbed: Makes a context at whose end the planner is as it was before.
        seconds: Time that paths, or a search for other choices, may take.

    Attributes:
        lookahead: The lookahead of the same model and settings.
    """

    def __init__(
        self,
        planner: Planner,
        model: TransitionModel,
        settings: PlannerSettings,
        name: str,
        undisturbed: Callable[[], contextlib.AbstractContextManager[None]] = contextlib.nullcontext,
        seconds: float = 10.0,
    ) -> None:
        self.lookahead = MonitorReplanner(model, settings)
        self.model, self.settings, self.name = model, settings, name
        self._planner, self._seconds, self._undisturbed = planner, seconds, undisturbed

    @classmethod
    def of_settings(
        cls, model: TransitionModel, settings: PlannerSettings, task: Task | None
    ) -> ChosenPlanner:
        """Return the planner that settings name, of a task's own planners or the installed ones.

        Raises:
            SettingsError: There is no such planner.
        """
        refuse_unknown_names(Settings(planner=settings), task)
        planner = make_planner(model, settings, None if task is None else task.planners)
        return cls(planner, model, settings, f"The planner {settings.name}")

    def forecast(self, state: Vector) -> Forecast:
        """Return the planner's own forecast for a state `[F]`."""
        return self._planner.forecast(state)

    def plan(self, state: Vector) -> Plan:
        """Plan from an observed state `[F]`; the planner is then as it was before."""
        near = self.lookahead.plan(state)
        with self._undisturbed():
            forecast = self.forecast(state)
            columns = zip(forecast, near.forecast, strict=True)
            if all(np.array_equal(np.asarray(own), np.asarray(its)) for own, its in columns):
                return near
            names = [action.name for action in self.model.actions]
            path = tuple(
                PlannedStep(names[k], s.reward, s.unsafe, s.risk, tuple(s.state.tolist()))
                for k, s in self._followed(state, forecast.choice)
            )
            return Plan(path, forecast, near.planning_graph)

    def _choose(self, state: Vector) -> int:
        return self.forecast(state).choice

    def _followed(self, state: Vector, action: int) -> Iterator[tuple[int, Outcome]]:
        """Yield what the planner does by the model from an action on, and what that leads to."""
        plan = self._planner.plan if isinstance(self._planner, PlanFollower) else ()
        for _ in range(len(plan) or self.settings.depth):
            step = self.model.step(state, action) if action >= 0 else None
            if step is None or not step.applicable:
                return
            yield action, step
            action, state = -1 if step.terminal else self._choose(step.state), step.state

    @staticmethod
    def decided_by_graph(plan: Plan) -> bool:
        """Return whether a plan is what its planning graph decides."""
        return plan.forecast is plan.planning_graph.forecast

    def paths(self, state: Vector, plan: Plan) -> list[list[int]]:
        """Return the ground actions, one a control period, of the best path by each action.

        Where the planning graph decides, they are the paths that the graph values; of a planner
        that searches for whole plans it is the plan alone, else what there is time for.
        """
        actions = range(len(self.model.actions))
        if self.decided_by_graph(plan):
            return plan.paths
        if isinstance(self._planner, PlanFollower):
            own = [self.model.action_index(step.action) for step in plan.path]
            return [own if action == plan.action else [] for action in actions]
        deadline = time.monotonic() + self._seconds
        with self._undisturbed():
            return [
                [step for step, _ in self._followed(state, action)]
                if time.monotonic() < deadline
                else []
                for action in actions
            ]

    def explain(self, state: Vector, plan: Plan) -> Explanation:
        """Return the account of a plan."""
        return explain(
            self.model,
            state,
            plan.forecast,
            plan.action,
            paths=self.paths(state, plan),
            discount=self.settings.discount,
        )

    def other_choices(
        self, state: Vector, ranges: tuple[Vector, Vector], whole: Collection[int]
    ) -> Counterfactuals:
        """Return the changes of one fluent with which the planner chooses otherwise.

        `ranges` and `whole` are those of `counterfactuals`.
        """
        names = [*(action.name for action in self.model.actions), "no action"]
        with self._undisturbed():
            return counterfactuals(
                self._choose, self.model.written, state, ranges, whole=whole,
                called=names.__getitem__, seconds=self._seconds,
            )  # fmt: skip

    def sight(self, plan: Plan) -> str:
        """Say how far the planner saw."""
        if isinstance(self._planner, PlanFollower) and self._planner.plan:
            length = plural(len(self._planner.plan), "action")
            return f"{self.name} follows a plan of {length} to the goal."
        discount = f"with discount {readable(self.settings.discount)}"
        if plan.forecast.bound is Bound.EXHAUSTED:
            return f"{self.name} expanded every reachable state {discount}."
        states = f" ({plural(plan.nodes, 'state')})" if self.decided_by_graph(plan) else ""
        why = {
            Bound.CELLS: " Rewards beyond the lookahead are estimated from cell values.",
            Bound.UNKNOWN: f" {TO_THE_UNKNOWN}",
            Bound.NODES: " A limit on nodes or edges ended the lookahead.",
        }.get(plan.forecast.bound, "")
        depth = plural(plan.forecast.depth, "action")
        return f"{self.name} looked ahead {depth}{states} {discount}.{why}"
