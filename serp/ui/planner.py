"""The planner that a training would have, for `serp plan` and `serp play`."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click
import numpy as np
from click.core import ParameterSource

from serp._util.text import plural, readable
from serp.agent.counterfactuals import Flips, flips_of
from serp.agent.registry import make_planner, refuse_unknown_names
from serp.agent.sentences import TO_THE_UNKNOWN
from serp.errors import SerpError
from serp.planning.edges import Bound
from serp.planning.lookahead import Lookahead
from serp.planning.plan_follower import PlanFollower
from serp.planning.replanner import MonitorReplanner, Plan, PlannedStep
from serp.runs.recording_format import HEADER, RECORDING
from serp.settings import Settings
from serp.ui.asked import open_run

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from serp.agent.agent import Agent
    from serp.agent.protocols import Planner
    from serp.model.domain import Domain
    from serp.model.learned.adoption import ModelAdoption
    from serp.model.transition_model import TransitionModel, Vector
    from serp.planning.forecast import Forecast
    from serp.runs.recording import Recording
    from serp.settings import PlannerSettings
    from serp.tasks.task import Task
    from serp.ui.state import MakePlanner


class ChosenPlanner(MonitorReplanner):
    """Any planner, in the form that `serp plan` shows.

    Values and choices are the planner's own. Where they are those of the lookahead, the plan is its
    plan: path and planning graph are what it values. The path of another decision is where choices
    lead to by the model, a control period a step, and the graph is that of the lookahead alone.

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
            if _alike(found, near.forecast):
                return near
            path = self._path(now, found.choice)
            return Plan.of(self.model, found, path, near.planning_graph)

    @staticmethod
    def decided_by_graph(plan: Plan) -> bool:
        """Return whether a plan is what its planning graph decides."""
        return plan.forecast is plan.planning_graph.forecast

    def paths(self, plan: Plan, state: Vector) -> list[list[int]]:
        """Return where each action leads to, a control period a step, as far as there is time.

        Where the planning graph decides, these are the paths that it values. Of a planner that
        searches for whole plans, this is the plan alone.
        """
        if self.decided_by_graph(plan):
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
        near, repeat = self.decided_by_graph(plan), self.settings.repeat
        if plan.bound is Bound.NODES and not near:  # that of a closed graph
            repeat = 1
        each = f", each repeated for {repeat} control periods" if repeat > 1 else ""
        states = f": {plural(plan.nodes, 'state')}" if near else ""
        closes = not isinstance(self._planner, Lookahead)
        began = "could not follow all that can be reached, and " if closes else ""
        ahead = f"{plural(plan.depth, 'action')}{each}{states}"
        saw = f"{self._called} {began}looked ahead {ahead}, {discount}."
        if plan.bound is Bound.CELLS:
            saw += " Values of cells stand for what lies beyond."
        elif plan.bound is Bound.UNKNOWN:
            saw += f" {TO_THE_UNKNOWN}"
        elif plan.bound is Bound.TIME:
            saw += " The time budget ended the lookahead there."
        elif plan.bound is Bound.NODES:
            ended = "The next layer would exceed the limits on nodes and edges."
            saw += f" {ended if near else 'Its budget ended there.'}"
        return saw


def chosen_planner(
    model: TransitionModel, settings: PlannerSettings, task: Task | None, time_budget: float
) -> ChosenPlanner:
    """Return the planner that settings name.

    Args:
        model: The model that it plans with.
        settings: Its settings.
        task: Has further planners; None for none.
        time_budget: Seconds that the lookahead may take.

    Raises:
        SettingsError: There is no such planner.
    """
    own = {} if task is None else task.planners
    refuse_unknown_names(Settings(planner=settings), own)
    planner = make_planner(model, settings, own)
    return ChosenPlanner(planner, model, settings, time_budget, f"The planner {settings.name}")


def _alike(one: Forecast, other: Forecast) -> bool:
    columns = zip(one, other, strict=True)
    return all(np.array_equal(np.asarray(mine), np.asarray(its)) for mine, its in columns)


_FIXED: Final = {
    "name": "--domain",
    "problem": "--problem",
    "max_ground_schemas": "--max-ground-schemas",
    "planner_name": "--planner",
    "depth": "--depth",
    "discount": "--discount",
    "repeat": "--repeat",
    "dt": "--dt",
    "settings": "--set",
}
"""What a run has of its own."""


class RunPlanner(ChosenPlanner):
    """The planner of a run, with the model that it plans with.

    Args:
        agent: The agent of the run.
        time_budget: Seconds that the lookahead may take.
        recording: The recorded steps of the run; None if there are none.
    """

    def __init__(self, agent: Agent, time_budget: float, recording: Recording | None) -> None:
        super().__init__(
            agent.arbiter.planner,
            agent.arbiter.model,
            agent.settings.planner,
            time_budget,
            "The planner of the run",
            agent.undisturbed,
        )
        self._adaptation = agent.adaptation
        self._recording = recording

    def flips(self, state: Vector) -> Flips | None:
        """Return the changes of one fluent with which the planner chooses otherwise.

        They are searched within the values that the run has recorded; None without a recording.
        """
        if self._recording is None or not len(self._recording):
            return None
        names = [*(action.name for action in self.model.actions), "no action"]
        with self._undisturbed():
            return flips_of(
                lambda s: self._planner.forecast(s).choice, self.model.written, state,
                self._recording.ranges, whole=self._recording.whole, called=names.__getitem__,
                seconds=self.time_budget or 0.0,
            )  # fmt: skip

    @property
    def adoption(self) -> ModelAdoption:
        """What the model is made of."""
        return self._adaptation.adoption


def asked_run(folder: Path, time_budget: float) -> tuple[Domain, Task, MakePlanner]:
    """Return domain, task and planner of the run that `serp plan` is asked for."""
    context = click.get_current_context()
    for name, option in _FIXED.items():
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"{option} cannot be given beside a run, which has its own")
    if not folder.is_dir():
        raise click.UsageError(
            f"there is no run {folder}; a task or a domain file is given as --domain {folder}"
        )
    run = open_run(folder)
    agent = run.agent

    def make_planner(domain: Domain) -> RunPlanner:
        if domain.model.fluents != agent.arbiter.model.fluents:
            raise SerpError("--state gives a value to what the problem file of the run fixes")
        recorded = (folder / RECORDING / HEADER).is_file()
        return RunPlanner(agent, time_budget, run.recording() if recorded else None)

    return agent.task.domain, run.task, make_planner
