"""The planner that a command shows: that of a training, or of a run."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
from click.core import ParameterSource

from serp._util.text import plural, readable
from serp.agent.counterfactuals import Counterfactuals, counterfactuals
from serp.agent.explanation import Explanation, explain, followed, paths_by
from serp.agent.registry import make_planner, refuse_unknown_names
from serp.agent.sentences import TO_THE_UNKNOWN
from serp.errors import SerpError
from serp.planning.edges import Bound
from serp.planning.lookahead import Lookahead
from serp.planning.plan_follower import PlanFollower
from serp.planning.replanner import MonitorReplanner, Plan, PlannedStep
from serp.runs.recording import HEADER, RECORDING
from serp.settings import Settings
from serp.ui.asked import MakePlanner, open_run

if TYPE_CHECKING:
    from collections.abc import Callable

    from serp.agent.protocols import Planner
    from serp.model.domain import Domain
    from serp.model.transition_model import TransitionModel, Vector
    from serp.planning.forecast import Forecast
    from serp.runs.run import Run
    from serp.settings import PlannerSettings
    from serp.tasks.task import Task


class ChosenPlanner:
    """Any planner, in the form that `serp plan` shows.

    Values and choices are the planner's own. Where they are those of the lookahead, the plan is its
    plan: path and planning graph are what it values. The path of another decision is where choices
    lead to by the model, a control period a step, and the graph is that of the lookahead alone.

    Args:
        planner: The planner.
        model: The model that it plans with.
        settings: Its settings.
        seconds: Time that a plan may take.
        name: Its name in messages.
        undisturbed: Makes a context at whose end the planner is as it was before.

    Attributes:
        lookahead: The lookahead of the same model and settings.
    """

    def __init__(
        self,
        planner: Planner,
        model: TransitionModel,
        settings: PlannerSettings,
        seconds: float,
        name: str,
        undisturbed: Callable[[], contextlib.AbstractContextManager[None]] = contextlib.nullcontext,
    ) -> None:
        self.lookahead = MonitorReplanner.of(model, settings, time_budget=seconds)
        self.model, self.settings = model, settings
        self._planner, self._seconds, self._name = planner, seconds, name
        self._undisturbed = undisturbed

    def plan(self, state: Vector) -> Plan:
        """Plan from an observed state `[F]`; the planner is then as it was before."""
        near = self.lookahead.plan(state)
        if isinstance(self._planner, Lookahead):
            return near
        with self._undisturbed():
            forecast = self._planner.forecast(state)
            if _alike(forecast, near.forecast):
                return near
            names = [action.name for action in self.model.actions]
            steps = followed(self.model, self._choose, state, forecast.choice, self._most)
            path = tuple(
                PlannedStep(names[k], s.reward, s.unsafe, s.risk, tuple(s.state.tolist()))
                for k, s in steps
            )
            return Plan(path, forecast, near.planning_graph)

    @property
    def _most(self) -> int:
        plan = self._planner.plan if isinstance(self._planner, PlanFollower) else ()
        return len(plan) or self.settings.depth

    def _choose(self, state: Vector) -> int:
        return self._planner.forecast(state).choice

    @staticmethod
    def decided_by_graph(plan: Plan) -> bool:
        """Return whether a plan is what its planning graph decides."""
        return plan.forecast is plan.planning_graph.forecast

    def explain(self, state: Vector, plan: Plan) -> Explanation:
        """Return the account of a plan.

        Where the planning graph decides, it has the paths that the graph values; of a planner that
        searches for whole plans it has the plan alone, else paths as far as there is time.
        """
        if self.decided_by_graph(plan):
            paths = plan.paths
        elif isinstance(self._planner, PlanFollower):
            paths = [[] for _ in self.model.actions]
            if plan.action is not None:
                paths[plan.action] = [self.model.action_index(step.action) for step in plan.path]
        else:
            with self._undisturbed():
                paths = paths_by(self.model, self._choose, state, self._most, self._seconds)
        discount = self.settings.discount
        return explain(
            self.model, state, plan.forecast, plan.action, paths=paths, discount=discount
        )

    def sight(self, plan: Plan) -> str:
        """Say how far the planner saw."""
        if isinstance(self._planner, PlanFollower) and self._planner.plan:
            length = plural(len(self._planner.plan), "action")
            return f"{self._name} follows a plan of {length} to the goal."
        discount = f"discount {readable(self.settings.discount)}"
        if plan.bound is Bound.EXHAUSTED:
            return f"{self._name} saw everything that can be reached, {discount}."
        states = f": {plural(plan.nodes, 'state')}" if self.decided_by_graph(plan) else ""
        ahead = f"{plural(plan.depth, 'action')}{states}"
        why = {
            Bound.CELLS: " Values of cells stand for what lies beyond.",
            Bound.UNKNOWN: f" {TO_THE_UNKNOWN}",
            Bound.TIME: " The time budget ended the lookahead.",
            Bound.NODES: " The limits on nodes and edges ended the lookahead.",
        }.get(plan.bound, "")
        return f"{self._name} looked ahead {ahead}, {discount}.{why}"


def _alike(one: Forecast, other: Forecast) -> bool:
    columns = zip(one, other, strict=True)
    return all(np.array_equal(np.asarray(mine), np.asarray(its)) for mine, its in columns)


def chosen_planner(
    model: TransitionModel, settings: PlannerSettings, task: Task | None, seconds: float
) -> ChosenPlanner:
    """Return the planner that settings name, of a task's own planners or the installed ones.

    Raises:
        SettingsError: There is no such planner.
    """
    own = {} if task is None else task.planners
    refuse_unknown_names(Settings(planner=settings), own)
    planner = make_planner(model, settings, own)
    return ChosenPlanner(planner, model, settings, seconds, f"The planner {settings.name}")


class RunPlanner(ChosenPlanner):
    """The planner of a run, with the model that it plans with."""

    def __init__(self, run: Run, seconds: float) -> None:
        agent = run.agent
        super().__init__(
            agent.arbiter.planner, agent.arbiter.model, agent.settings.planner, seconds,
            "The planner of the run", agent.undisturbed,
        )  # fmt: skip
        self._run = run
        self.adoption = agent.adaptation.adoption

    def counterfactuals(self, state: Vector) -> Counterfactuals | None:
        """Return the changes of one fluent with which the planner chooses otherwise.

        They are searched within the values that the run has recorded; None without a recording.
        """
        if not (self._run.path / RECORDING / HEADER).is_file():
            return None
        recording = self._run.recording()
        if not len(recording):
            return None
        names = [*(action.name for action in self.model.actions), "no action"]
        with self._undisturbed():
            return counterfactuals(
                self._choose, self.model.written, state, recording.ranges, whole=recording.whole,
                called=names.__getitem__, seconds=self._seconds,
            )  # fmt: skip


def asked_run(folder: Path, seconds: float) -> tuple[Domain, Task, MakePlanner]:
    """Return domain, task and planner of the run that `serp plan` is asked for."""
    # What a run has of its own.
    fixed = {
        "name": "--domain",
        "problem": "--problem",
        "max_ground_schemas": "--max-ground-schemas",
        "planner_name": "--planner",
        "depth": "--depth",
        "dt": "--dt",
        "settings": "--set",
    }
    context = click.get_current_context()
    for name, option in fixed.items():
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"{option} cannot be given beside a run, which has its own")
    if not folder.is_dir():
        raise click.UsageError(
            f"there is no run {folder}; a task or a domain file is given as --domain {folder}"
        )
    run = open_run(folder)

    def make_planner(domain: Domain) -> RunPlanner:
        if domain.model.fluents != run.agent.arbiter.model.fluents:
            raise SerpError("--state gives a value to what the problem file of the run fixes")
        return RunPlanner(run, seconds)

    return run.agent.task.domain, run.task, make_planner
