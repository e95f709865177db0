"""The planner of a run, for `serp plan RUN`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import click
from click.core import ParameterSource

from serp.cli.asked import open_run
from serp.cli.chosen_planner import ChosenPlanner
from serp.errors import SerpError
from serp.explanation.flips import Flips, flips_of
from serp.runs.recording_format import HEADER, RECORDING

if TYPE_CHECKING:
    from serp.adaptation.adoption import ModelAdoption
    from serp.cli.state import MakePlanner
    from serp.model.loading import Domain
    from serp.model.transition_model import Vector
    from serp.runs.recording import Recording
    from serp.tasks.task import Task
    from serp.training.agent import Agent

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
