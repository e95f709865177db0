"""The scenarios beside a domain, run on the text as it is edited."""

from __future__ import annotations

from dataclasses import dataclass

from serp.authoring.scenarios.checking import Result
from serp.authoring.scenarios.files import ScenarioFile, add_situation
from serp.model.domain import Domain
from serp.pddl.source import Source
from serp.settings import resolve
from serp.tasks.task import Task
from serp.ui.studio.view import ShownState, Surroundings, Version


@dataclass(frozen=True)
class EditedScenarios:
    """Scenarios as they are edited, with the texts and the task that they are about.

    A wrong text is a SerpError.
    """

    source: Source
    version: Version
    surroundings: Surroundings
    task: Task | None

    def run(self) -> list[Result]:
        """Check all scenarios as `serp test` does; this may take some seconds."""
        return list(self._file().run())

    def with_state(self, title: str, shown: ShownState) -> str:
        """Return the text with one more scenario: what holds in a state."""
        file = self._file()
        model = file.decider.model
        values = {name: float(value) for name, value in model.values(shown.state(model)).items()}
        remark = " ".join(shown.origin.split()) or "set by hand"
        return add_situation(file, " ".join(title.split()), values, remark)

    def _file(self) -> ScenarioFile:
        task = self.task
        observed = task is not None and not task.closed
        domain = Domain.parse(*self.version.sources(), observed=observed)
        settings = resolve("default", None if task is None else task.settings)
        return ScenarioFile.open(self.source, domain, settings, self.surroundings.dt, task)
