"""Runs the scenarios of a file, and writes one more."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from serp.agent.protocols import undisturbed
from serp.authoring.scenarios.checking import Decider, Result, check
from serp.authoring.scenarios.reading import read_scenarios
from serp.authoring.scenarios.syntax import REASONS, SUFFIX
from serp.errors import SerpError
from serp.model.domain import Domain
from serp.pddl.source import Source, newline_of


def run_scenarios(source: Source, decider: Decider, words: str = "") -> Iterator[Result]:
    """Check the scenarios of a file one by one; with `words`, those whose title has them.

    What the planner keeps of one is forgotten before the next, so that none depends on others.

    Raises:
        DomainError: The file is wrong.
    """
    for scenario in read_scenarios(source, decider.domain, decider.model):
        if words.lower() in scenario.title.lower():
            with undisturbed(decider.arbiter.planner):
                result = check(scenario, decider)
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
    model = domain.model
    numeric = next((fluent.name for fluent in model.fluents if fluent.numeric), None)
    given = "" if numeric is None else f"    ({numeric}) = 0\n"
    action = model.actions[0].name if model.actions else "an-action"
    raise SerpError(
        f"{domain.source.name} has no scenarios: there is no {file}\n"
        "  write one, for example:\n\n"
        f"  scenario what the planner does at first\n{given}    chooses {action}\n"
    )


def add_situation(
    source: Source, decider: Decider, title: str, values: Mapping[str, float], remark: str
) -> str:
    """Return the text of a file with a scenario of what holds where fluents have `values`.

    It replaces a scenario of the same title. `remark` is a comment on where the situation comes
    from.
    """
    newline = newline_of(source.text)
    written = newline.join(
        [
            f"scenario {title}",
            f"  ; {remark}",
            *_situation(values, decider),
            *_expected(values, decider, title),
        ]
    )
    for scenario in read_scenarios(source, decider.domain, decider.model):
        if scenario.title.lower() == title.lower():
            begin = source.line_starts[scenario.place.line - 1]
            last = scenario.expectations[-1].place.line
            end = source.line_starts[last - 1] + len(source.line_text(last))
            return source.text[:begin] + written + source.text[end:]
    before = source.text.rstrip("\r\n") + 2 * newline if source.text else ""
    return before + written + newline


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


def _expected(values: Mapping[str, float], decider: Decider, title: str) -> list[str]:
    decision = decider.arbiter.plan(decider.model.state(values))
    # Other reasons of refusals belong to most actions of many domains.
    dangers = {REASONS[word]: word for word in ("unsafe", "unsafe ahead", "too risky")}
    expected = []
    if (chosen := decider.executed(decision)) >= 0:
        expected.append(f"  chooses {decider.name(chosen)}")
    for action in range(len(decider.model.actions)):
        reason = decider.refusal(decision, action)
        if reason in dangers:
            expected.append(f"  refuses {decider.name(action)} because {dangers[reason]}")
    if not expected:
        raise SerpError(f"{title}: the planner has no action there, and none is dangerous")
    return expected
