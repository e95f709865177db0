"""Runs the scenarios of a file."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from serp._util.text import listed
from serp.agent.protocols import undisturbed
from serp.authoring.scenarios.checking import Decider, Recorded, Result, check
from serp.authoring.scenarios.reading import observed_in, read_scenarios
from serp.authoring.scenarios.syntax import REASONS, SUFFIX, Scenario, StepOfRun
from serp.errors import SerpError
from serp.model.domain import Domain
from serp.pddl.source import Source, newline_of
from serp.runs.recording import Recording, StoredStep, open_recording
from serp.settings import Settings
from serp.tasks.task import Task

_opened = functools.lru_cache(4)(open_recording)


def recorded_step(run: Path, step: int, episode: int | None) -> tuple[Recording, StoredStep]:
    """Return a step of a run, and the recording that holds it.

    Args:
        run: The folder of the run.
        step: Its position in the run, from 0, or with `episode` in the episode, from 1.
        episode: Number of the episode, from 1.

    Raises:
        RunError: There is no such run, recording or step.
    """
    recording = _opened(run)
    position = step if episode is None else recording.find(episode, step)
    return recording, recording.step(position)


def recorded_values(of: StepOfRun) -> dict[str, float]:
    """Return fluent → value of a step that a scenario names.

    Raises:
        RunError: There is no such run, recording or step.
    """
    recording, stored = recorded_step(Path(of.run), of.step, of.episode)
    return dict(zip(recording.layout.fluents, stored.state.tolist(), strict=True))


@dataclass(frozen=True)
class ScenarioFile:
    """A scenario file, and who decides in it."""

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


_DANGERS: Final = ("unsafe", "unsafe ahead", "too risky")
"""Reasons of refusals that are written down; other ones belong to most actions of many domains."""


def add_scenario(
    file: ScenarioFile, title: str, where: str, recording: Recording, step: StoredStep
) -> str:
    """Return the text of a file with a recorded step as a scenario; see `add_situation`.

    `where` says where the step was recorded.
    """
    decider, names = file.decider, recording.layout.fluents
    values = dict(zip(names, step.state.tolist(), strict=True))
    other = sorted(values.keys() ^ decider.start.keys())
    if other:
        raise SerpError(
            f"{where}: the run has other fluents than {decider.domain.source.name}: {listed(other)}"
        )
    decision = step.decision
    executed = recording.layout.actions[decision.action]
    remark = f"{where}: {decision.executed_by} executed {executed} ({decision.reason})"
    return add_situation(file, title, values, remark)


def add_situation(file: ScenarioFile, title: str, values: Mapping[str, float], remark: str) -> str:
    """Return the text of a file with a scenario of what holds in a situation.

    Args:
        file: The scenario file.
        title: The title of the scenario, which replaces one that has it.
        values: Every fluent → its value.
        remark: Where the situation comes from, a comment of the scenario.

    Raises:
        DomainError: The file is wrong.
        SerpError: Nothing can be expected there.
    """
    lines = [f"scenario {title}", f"  ; {remark}", *_situation(values, file.decider)]
    lines += _expected(values, file.decider, title)
    return _with(file.source, file.scenarios(), lines)


def _situation(values: Mapping[str, float], decider: Decider) -> Iterator[str]:
    start = decider.start
    for fluent in decider.model.fluents:
        value = values[fluent.name]
        if value == start[fluent.name]:
            continue
        if fluent.numeric:
            yield f"  ({fluent.name}) = {value!r}"
        else:
            yield f"  ({fluent.name})" if value else f"  not ({fluent.name})"


def _expected(values: Mapping[str, float], decider: Decider, where: str) -> list[str]:
    decision = decider.decide(decider.model.state(values))
    dangers = {REASONS[word]: word for word in _DANGERS}
    expected = []
    if (chosen := decider.executed(decision)) >= 0:
        expected.append(f"  chooses {decider.name(chosen)}")
    for action in range(len(decider.model.actions)):
        reason = decider.refusal(decision, action)
        if reason in dangers:
            expected.append(f"  refuses {decider.name(action)} because {dangers[reason]}")
    if not expected:
        raise SerpError(f"{where}: the planner has no action there, and none is dangerous")
    return expected


def _with(source: Source, known: Sequence[Scenario], lines: list[str]) -> str:
    newline = newline_of(source.text)
    title = lines[0].removeprefix("scenario ").lower()
    for scenario in known:
        if scenario.title.lower() == title:
            begin = source.line_starts[scenario.place.line - 1]
            last = scenario.expectations[-1].place.line
            end = source.line_starts[last - 1] + len(source.line_text(last))
            return source.text[:begin] + newline.join(lines) + source.text[end:]
    before = source.text
    if before:
        before = before.rstrip("\r\n") + 2 * newline
    return before + newline.join(lines) + newline
