"""The planner of a run, for `serp plan RUN`."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click
from click.core import ParameterSource

from serp._util.number_format import readable
from serp._util.text import plural
from serp.cli.asked import open_run
from serp.errors import SerpError
from serp.planning.limits import Bound
from serp.planning.replanner import MonitorReplanner, PlannedStep

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from serp.adaptation.adoption import ModelAdoption
    from serp.cli.state import MakePlanner
    from serp.model.loading import Domain
    from serp.model.transition_model import Vector
    from serp.planning.replanner import Plan
    from serp.tasks.task import Task
    from serp.training.agent import Agent

_FIXED: Final = {
    "name": "--domain",
    "problem": "--problem",
    "max_ground_schemas": "--max-ground-schemas",
    "depth": "--depth",
    "discount": "--discount",
    "repeat": "--repeat",
    "dt": "--dt",
    "settings": "--set",
}
"""What a run has of its own."""


class RunPlanner(MonitorReplanner):
    """The planner of a run, with the model that it plans with.

    Values and choices are those of the run's own planner. The path is where they lead to by the
    model, a control period a step; the graph is that of the lookahead alone.

    Args:
        agent: The agent of the run.
        time_budget: Seconds that the lookahead may take.
    """

    def __init__(self, agent: Agent, time_budget: float) -> None:
        used = agent.settings.planner
        super().__init__(
            agent.arbiter.model,
            depth=used.depth,
            discount=used.discount,
            repeat=used.repeat,
            max_nodes=used.max_nodes,
            accepted_risk=used.accepted_risk,
            time_budget=time_budget,
        )
        self._agent = agent

    @property
    def adoption(self) -> ModelAdoption:
        """What the model is made of."""
        return self._agent.adaptation.adoption

    def lookahead(self, state: ArrayLike) -> Plan:
        """Plan by the lookahead alone."""
        return super().plan(state)

    def plan(self, state: ArrayLike) -> Plan:
        """Plan from an observed state `[F]`; the planner of the run is then as it was before."""
        with self._agent.undisturbed():
            return self._plan(state)

    def _plan(self, state: ArrayLike) -> Plan:
        lookahead, planner = self.lookahead(state), self._agent.arbiter.planner
        now = self.model.check_state(state)
        found = planner.forecast(now)
        chosen = found.choice if found.choice >= 0 else None
        return dataclasses.replace(
            lookahead,
            action=chosen,
            name=None if chosen is None else self.model.actions[chosen].name,
            path=self._path(now, found.choice),
            reward=0.0 if chosen is None else float(found.value[chosen]),
            safe=found.safe,
            indifferent=found.indifferent,
            depth=found.depth,
            bound=found.bound,
            forecast=found,
        )

    def _path(self, state: Vector, choice: int) -> tuple[PlannedStep, ...]:
        path: list[PlannedStep] = []
        while choice >= 0 and len(path) < self.settings.depth:
            step = self.model.step(state, choice)
            state, name = step.state, self.model.actions[choice].name
            end = tuple(state.tolist())
            path.append(PlannedStep(name, step.reward, step.unsafe, step.risk, end))
            if step.terminal:
                break
            choice = self._agent.arbiter.planner.forecast(state).choice
        return tuple(path)

    def sight(self, plan: Plan) -> str:
        """Say how far the planner saw."""
        discount = f"discount {readable(self.settings.discount)}"
        if plan.bound is Bound.EXHAUSTED:
            return f"The planner of the run saw everything that can be reached, {discount}."
        saw = f"The planner of the run looked ahead {plural(plan.depth, 'action')}, {discount}."
        if plan.bound is Bound.CELLS:
            saw += " Values of cells stand for what lies beyond."
        return saw if plan.bound in (Bound.CELLS, Bound.DEPTH) else f"{saw} Its budget ended there."


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
        return RunPlanner(agent, time_budget)

    return agent.task.domain, run.task, make_planner
