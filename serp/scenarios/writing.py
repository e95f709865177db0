"""Writes scenarios from recorded steps into a scenario file; what else is in it stays as it is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from serp._util.text import listed
from serp.errors import SerpError
from serp.pddl.edits import newline_of
from serp.pddl.source import Source
from serp.runs.recording import Recording, StoredStep
from serp.scenarios.decider import Decider
from serp.scenarios.running import ScenarioFile
from serp.scenarios.syntax import REASONS, Scenario

_DANGERS: Final = ("unsafe", "unsafe ahead", "too risky")
"""Reasons of refusals that are written down; other ones belong to most actions of many domains."""


def add_scenario(
    file: ScenarioFile, title: str, where: str, recording: Recording, step: StoredStep
) -> str:
    """Return the text of a file with a recorded step in it, as a scenario of what holds there.

    It replaces the scenario of the same title, or comes at the end. All other bytes stay.

    Args:
        file: The scenario file.
        title: The title of the scenario.
        where: Where the step was recorded, in words.
        recording: What holds the step.
        step: The step.

    Raises:
        DomainError: The file is wrong.
        SerpError: The run has other fluents, or nothing can be expected of the step.
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
