"""The planner that a command shows: that of a training, or of a run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from serp.agent.chosen_planner import ChosenPlanner
from serp.agent.registry import make_planner, refuse_unknown_names
from serp.errors import SerpError
from serp.runs.recording import HEADER, RECORDING
from serp.settings import Settings
from serp.ui.asked import MakePlanner, open_run
from serp.ui.options import refuse_given

if TYPE_CHECKING:
    from serp.agent.counterfactuals import Counterfactuals
    from serp.model.domain import Domain
    from serp.model.transition_model import TransitionModel, Vector
    from serp.runs.run import Run
    from serp.settings import PlannerSettings
    from serp.tasks.task import Task


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
        return self.other_choices(state, recording.ranges, recording.whole)


def asked_run(folder: Path, seconds: float) -> tuple[Domain, Task, MakePlanner]:
    """Return domain, task and planner of the run that `serp plan` is asked for."""
    own = ("name", "problem", "max_ground_schemas", "planner_name", "depth", "dt", "settings")
    refuse_given(own, "cannot be given beside a run, which has its own")
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
