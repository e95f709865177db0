"""Runs the scenarios of a file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from serp.control.protocols import undisturbed
from serp.errors import SerpError
from serp.model.loading import Domain
from serp.pddl.source import Source
from serp.scenarios.checking import Recorded, Result, check
from serp.scenarios.decider import Decider
from serp.scenarios.line import SUFFIX
from serp.scenarios.reading import observed_in, read_scenarios
from serp.scenarios.syntax import Scenario
from serp.settings import Settings
from serp.tasks.task import Task


@dataclass(frozen=True)
class ScenarioFile:
    """A scenario file and who decides in it.

    Attributes:
        source: The file.
        decider: Who decides.
    """

    source: Source
    decider: Decider

    @classmethod
    def open(
        cls,
        source: Source,
        domain: Domain,
        settings: Settings,
        dt: float,
        task: Task | None = None,
    ) -> ScenarioFile:
        """Return the scenarios of a domain that nothing is learned of yet.

        What the scenarios give a value to is observed, even where no effect changes it.
        """
        return cls(source, Decider.of_domain(observed_in(source, domain), settings, dt, task))

    def scenarios(self) -> list[Scenario]:
        """Read the file.

        Raises:
            DomainError: It is wrong.
        """
        return read_scenarios(self.source, self.decider.domain, self.decider.model)

    def run(self, recorded: Recorded, words: str = "") -> Iterator[Result]:
        """Check scenarios one by one; with `words`, those whose title has them.

        What the planner keeps of one is forgotten before the next, so that none depends on others.

        Raises:
            DomainError: The file is wrong.
        """
        for scenario in self.scenarios():
            if words.lower() in scenario.title.lower():
                with undisturbed(self.decider.arbiter.planner):
                    result = check(scenario, self.decider, recorded)
                yield result


def scenarios_beside(domain: Domain) -> Path:
    """Return the scenario file of a domain: `<name>.scenarios` beside `<name>.pddl`."""
    return Path(domain.source.name).with_suffix(SUFFIX)


def read_beside(domain: Domain) -> Source:
    """Read the scenario file of a domain.

    Raises:
        SerpError: There is none.
    """
    file = scenarios_beside(domain)
    if file.is_file():
        return Source.read(file)
    raise SerpError(
        f"{domain.source.name} has no scenarios: there is no {file}\n"
        f"  write one, for example:\n\n{_first(domain)}"
    )


def _first(domain: Domain) -> str:
    """Return a first scenario for a domain, as an example."""
    model = domain.model
    numeric = next((fluent.name for fluent in model.fluents if fluent.numeric), None)
    given = "" if numeric is None else f"    ({numeric}) = 0\n"
    action = model.actions[0].name if model.actions else "an-action"
    return f"  scenario what the planner does at first\n{given}    chooses {action}\n"
