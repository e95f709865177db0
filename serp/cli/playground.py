"""The domain that `serp play` plays: who is asked there, and where a situation is saved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from serp._util.text import plural
from serp.control.registry import refuse_unknown_names
from serp.errors import SerpError
from serp.model.loading import Domain
from serp.settings import Settings, resolve
from serp.tasks.task import Task
from serp.tasks.worlds.file_world import STEP_BY_STEP

if TYPE_CHECKING:
    from serp.cli.chosen_planner import ChosenPlanner
    from serp.play.game import Game


@dataclass(frozen=True)
class Playground:
    """A domain that is played by hand.

    Attributes:
        domain: The domain.
        task: The installed task that it belongs to; None for none.
        dt: Control period.
        changes: Section → setting → value.
        own_file: False for the file of an installed task, beside which nothing is written.
    """

    domain: Domain
    task: Task | None
    dt: float
    changes: Mapping[str, Mapping[str, Any]]
    own_file: bool

    def settings(self) -> Settings:
        """Return the settings that a training would have.

        Raises:
            SettingsError: There is no such setting or planner.
        """
        of_task = STEP_BY_STEP if self.task is None else self.task.settings
        resolved = resolve("default", of_task, self.changes)
        refuse_unknown_names(resolved, self.task.planners if self.task else {})
        return resolved

    def planner(self, domain: Domain) -> ChosenPlanner:
        """Return the planner that a training would have in a world."""
        # Imported when the planner is asked, because this imports numba.
        from serp.cli.chosen_planner import chosen_planner

        model = domain.model.replace(dt=self.dt)
        return chosen_planner(model, self.settings().planner, self.task, 10.0)

    def save(self, title: str, game: Game, begun: Mapping[str, float]) -> str:
        """Write the situation of a game as a scenario, with what holds there; say where.

        Args:
            title: Title of the scenario; one that has it is replaced.
            game: The game.
            begun: Fluent → value with which it began, beside the problem.

        Raises:
            SerpError: It cannot be written, or nothing can be expected there.
        """
        from serp._util.files import write_durably
        from serp.pddl.source import Source
        from serp.scenarios.running import ScenarioFile, scenarios_beside
        from serp.scenarios.writing import add_situation

        if not self.own_file:
            name = Path(self.domain.source.name).name
            raise SerpError(f"{name} is the file of an installed task; play a copy of it")
        if ";" in title:
            raise SerpError("a title has no `;`, which begins a comment")
        file, moment = scenarios_beside(self.domain), game.moment
        source = Source.read(file) if file.exists() else Source(str(file), "")
        known = {**begun, **moment.changed, **game.values}
        opened = ScenarioFile.open(
            source, self.domain.observed(known), self.settings(), self.dt, self.task
        )
        start = opened.decider.start
        values = {name: float(known.get(name, value)) for name, value in start.items()}
        remark = f"played by hand, after {plural(moment.steps, 'step')}"
        write_durably(file, add_situation(opened, title, values, remark))
        return f"{file}: the scenario `{title}` is written"
